"""Malformed track files: one row for each way in which a file can be wrong, and what must be said about it."""

GATE = "[[gates]]\nposition = [0, 0, 2]\nyaw_deg = 0\n"
SECOND = "[[gates]]\nposition = [12, 0, 2]\nyaw_deg = 0\n"
THIRD = "[[gates]]\nposition = [6, 8, 2]\nyaw_deg = 180\n"
NAME = 'name = "test"\n'
SOUND = NAME + GATE
POLE = "[[poles]]\nposition = [0, 3, 0]\nradius = 0.1\nheight = 3\n"


def with_gate(line: str) -> str:
    """A sound track whose only gate has one more line, or another in place of the one for that key."""
    key = line.split("=", maxsplit=1)[0].strip()
    kept = [row for row in GATE.splitlines() if not row.startswith(f"{key} ")]
    return NAME + "\n".join([*kept, line]) + "\n"


# name of the case: (file, every fault that must be named)
MALFORMED: dict[str, tuple[str, list[str]]] = {
    "no name": (GATE, ['name is missing: the track\'s name, as in name = "my track"']),
    "name of a wrong type": ("name = 3\n" + GATE, ["name must be text in quotes, got 3"]),
    "blank name": ('name = "  "\n' + GATE, ["name must be printable text that is not blank, got '  '"]),
    "control characters": (
        'name = "a\\u001b[2J"\n' + GATE,
        ["name must be printable text that is not blank, got 'a\\x1b[2J'"],
    ),
    "unknown key": ("lapps = 3\n" + SOUND, ["unknown key 'lapps'; did you mean 'laps'?"]),
    "unlike any key": (
        "colour = 3\n" + SOUND,
        ["unknown key 'colour'; known are name, laps, finish, frame_width, frame_depth, leave_distance, bounds, gates"],
    ),
    "no laps": ("laps = 0\n" + SOUND, ["laps must be 1 to 1000, got 0"]),
    "negative laps": ("laps = -2\n" + SOUND, ["laps must be 1 to 1000, got -2"]),
    "half a lap": ("laps = 1.5\n" + SOUND, ["laps must be a whole number, got 1.5"]),
    "laps that are true": ("laps = true\n" + SOUND, ["laps must be a whole number, got true"]),
    "too many laps": (f"laps = {10**30}\n" + SOUND, ["laps must be 1 to 1000, got a huge number"]),
    "negative frame": ("frame_width = -0.1\n" + SOUND, ["frame_width must be at least 0, got -0.1"]),
    "frame that is text": ('frame_width = "0.3"\n' + SOUND, ["frame_width must be a number, got '0.3'"]),
    "no leave distance": ("leave_distance = 0\n" + SOUND, ["leave_distance must be greater than 0, got 0"]),
    "infinite leave distance": ("leave_distance = inf\n" + SOUND, ["leave_distance must be finite, got inf"]),
    "no gates": (NAME, ["no gates: a track needs at least one [[gates]]"]),
    "empty gates": (NAME + "gates = []\n", ["no gates: a track needs at least one [[gates]]"]),
    "one table of gates": (
        NAME + GATE.replace("[[gates]]", "[gates]"),
        ["gates must be an array of tables, each headed [[gates]], got a table"],
    ),
    "gates that are numbers": (
        NAME + "gates = [1, 2]\n",
        ["gate 1: must be a table, got 1", "gate 2: must be a table, got 2"],
    ),
    "too many gates": (NAME + GATE * 201, ["201 gates are too many: at most 200"]),
    "no position": (
        NAME + "[[gates]]\nyaw_deg = 0\n",
        ["gate 1: position is missing: the centre of the opening, as in position = [10, 0, 2]"],
    ),
    "position in the plane": (
        with_gate("position = [0, 2]"),
        ["gate 1: position must be three numbers [x, y, z], got 2 of them"],
    ),
    "position that is a number": (
        with_gate("position = 3.5"),
        ["gate 1: position must be three numbers [x, y, z], got 3.5"],
    ),
    "position that is nowhere": (
        with_gate("position = [nan, 0, inf]"),
        ["gate 1: position x must be finite, got nan; z must be finite, got inf"],
    ),
    "position of text": (
        with_gate('position = [0, "1", [2]]'),
        ["gate 1: position y must be a number, got '1'; z must be a number, got an array"],
    ),
    "position far off": (
        with_gate("position = [1e30, 0, 2]"),
        ["gate 1: position x must lie within -10000 and 10000, got 1e+30"],
    ),
    "position of huge whole numbers": (
        with_gate(f"position = [0, {10**400}, 2]"),
        ["gate 1: position y must lie within -10000 and 10000, got a huge number"],
    ),
    "no yaw": (
        NAME + "[[gates]]\nposition = [0, 0, 2]\n",
        ["gate 1: yaw_deg is missing: the heading in which the gate is flown, 0 along x, 90 along y"],
    ),
    "two yaws": (with_gate("yaw_rad = 0.0"), ["gate 1: yaw_deg and yaw_rad are both given: keep one"]),
    "yaw that is false": (with_gate("yaw_deg = false"), ["gate 1: yaw_deg must be a number, got false"]),
    "yaw that is no number": (with_gate("yaw_deg = nan"), ["gate 1: yaw_deg must be finite, got nan"]),
    "yaw under its wrong name": (
        NAME + "[[gates]]\nposition = [0, 0, 2]\nyaw = 90\n",
        ["gate 1: unknown key 'yaw'; did you mean 'yaw_rad'?", "gate 1: yaw_deg is missing"],
    ),
    "no width": (with_gate("width = 0.0"), ["gate 1: width must be greater than 0, got 0.0"]),
    "negative height": (with_gate("height = -2"), ["gate 1: height must be greater than 0, got -2"]),
    "width that is a date": (
        with_gate("width = 2026-01-01"),
        ["gate 1: width must be a number, got 2026-01-01"],
    ),
    "bounds that are an array": (
        "bounds = [1, 2]\n" + SOUND,
        ["bounds: must be a table [bounds] with low and high, got an array"],
    ),
    "half of the bounds": (
        SOUND + "[bounds]\nlow = [-9, -9, 0]\n",
        ["bounds: high is missing: the highest corner, as in high = [20, 20, 10]"],
    ),
    "bounds with an unknown key": (
        SOUND + "[bounds]\nlow = [-9, -9, 0]\nhigh = [9, 9, 9]\nhihg = 3\n",
        ["bounds: unknown key 'hihg'; did you mean 'high'?"],
    ),
    "inverted bounds": (
        SOUND + "[bounds]\nlow = [9, -9, 0]\nhigh = [-9, 9, 9]\n",
        ["bounds: inverted: low x = 9 must be less than high x = -9"],
    ),
    "bounds without a floor": (
        SOUND + "[bounds]\nlow = [-9, -9, 1]\nhigh = [9, 9, 9]\n",
        ["bounds: low z must be at most 0, got 1: the ground is the floor"],
    ),
    "gate beside the bounds": (
        SOUND + "[bounds]\nlow = [-9, -0.5, 0]\nhigh = [9, 9, 9]\n",
        ["gate 1: is out of bounds: reaches y = -1, bounds begin at -0.5"],
    ),
    "gate above the bounds": (
        SOUND + "[bounds]\nlow = [-9, -9, 0]\nhigh = [9, 9, 2.5]\n",
        ["gate 1: is out of bounds: reaches z = 3, bounds end at 2.5"],
    ),
    "gate on the ground": (
        with_gate("position = [0, 0, 0]"),
        ["gate 1: lies under ground: its centre is at z = 0, must be above 0"],
    ),
    "gate under ground": (
        with_gate("position = [0, 0, -3]"),
        ["gate 1: lies under ground: its centre is at z = -3, must be above 0"],
    ),
    "the same gate twice": (
        NAME + GATE + GATE,
        ["gate 1: overlaps gate 2: their openings share room, their centres are 0 m apart"],
    ),
    "frame in an opening": (
        NAME + GATE + SECOND.replace("12, 0", "0, 2.2"),
        ["gate 1: overlaps gate 2: the frame of one stands in the other's opening, their centres are 2.2 m apart"],
    ),
    "frame in a tilted opening": (
        NAME + GATE + SECOND.replace("12, 0", "0.5, 0").replace("2]", "3.2]") + "pitch_deg = 90\n",
        ["gate 1: overlaps gate 2: the frame of one stands in the other's opening, their centres are 1.3 m apart"],
    ),
    "gates that cross": (
        NAME + GATE + "[[gates]]\nposition = [0.5, 0.5, 2.5]\nyaw_deg = 90\n",
        ["gate 1: overlaps gate 2: their openings share room, their centres are 0.866 m apart"],
    ),
    "gate that faces backwards": (
        NAME + GATE + SECOND.replace("yaw_deg = 0", "yaw_deg = 241") + THIRD,
        ["gate 2: faces away from the flight direction: yaw_deg is 241, flown at 63.43"],
    ),
    "gate out of reach": (
        "leave_distance = 5\n" + NAME + GATE + SECOND + THIRD,
        ["gate 1: the straight way to gate 2 is up to 6 m from every gate, beyond leave_distance = 5 m"],
    ),
    "unknown shape": (with_gate('shape = "star"'), ["gate 1: shape must be one of rectangle, round, got 'star'"]),
    "round gate with a width": (
        with_gate('shape = "round"\nwidth = 2'),
        ["gate 1: width is given: a round gate has a diameter"],
    ),
    "diameter of a rectangle": (
        with_gate("diameter = 2"),
        ['gate 1: diameter is given, which a round gate has: add shape = "round"'],
    ),
    "two rolls": (with_gate("roll_deg = 3\nroll_rad = 1"), ["gate 1: roll_deg and roll_rad are both given: keep one"]),
    "gate far from the origin": (
        with_gate("position = [9900, 0, 2]"),
        ["gate 1: is too far from the origin: at 9900 m, at most 500 m: move the track's middle there"],
    ),
    "poles that are a table": (
        SOUND + "[poles]\nposition = [5, 0, 0]\n",
        ["poles must be an array of tables, each headed [[poles]]"],
    ),
    "pole of nothing": (
        SOUND + "[[poles]]\ndiameter = 1\n",
        [
            "pole 1: unknown key 'diameter'; known are position, radius, height",
            "pole 1: position is missing: the middle of its foot, as in position = [3, 0, 0]",
            "pole 1: radius is missing: as in radius = 0.1",
            "pole 1: height is missing: as in height = 3",
        ],
    ),
    "pole in an opening": (
        SOUND + "[[poles]]\nposition = [0, 0.5, 0]\nradius = 0.1\nheight = 3\n",
        ["pole 1: stands in the opening of gate 1"],
    ),
    "pole under ground": (
        SOUND + "[[poles]]\nposition = [5, 0.5, -4]\nradius = 0.1\nheight = 3\n",
        ["pole 1: lies under ground: its top is at z = -1, must be above 0"],
    ),
    "wall out of bounds": (
        SOUND + "[[walls]]\nposition = [50, 0, 1]\nsize = [1, 0.2, 2]\n",
        ["wall 1: is out of bounds: stands at (50, 0)"],
    ),
    "wall without thickness": (
        SOUND + "[[walls]]\nposition = [5, 0, 1]\nsize = [1, 0, 2]\n",
        ["wall 1: size thickness must be greater than 0, got 0"],
    ),
    "empty start": (SOUND + "[start]\n", ["start: needs places, or the middle, yaw_deg and spacing of a line"]),
    "start at no gate": (
        SOUND + "[start]\ngate = 2\nmiddle = [-3, 0, 1]\nyaw_deg = 0\nspacing = 1\n",
        ["start: gate must be 1 to 1, got 2"],
    ),
    "start outside": (
        SOUND + "[start]\nplaces = [{position = [-3, 0, 1], yaw_deg = 0}, {position = [-30, 0, 1], yaw_deg = 0}]\n",
        ["start: place 2 at (-30, 0, 1) lies outside the track, under ground or in a solid"],
    ),
    "start in a wall": (
        SOUND
        + "[start]\nmiddle = [-3, 0, 1]\nyaw_deg = 0\nspacing = 1\n"
        + "[[walls]]\nposition = [-3, 0, 1]\nsize = [1, 0.2, 2]\n",
        ["start: middle at (-3, 0, 1) lies outside the track, under ground or in a solid"],
    ),
    "no room for a start": (
        SOUND + "[bounds]\nlow = [-1, -9, 0]\nhigh = [9, 9, 9]\n",
        ["no gate has room for a start: 1.6 m before it must lie within the bounds and off all solids"],
    ),
    "motion that is no table": (
        with_gate("motion = 3"),
        ["gate 1: motion: must be a table, as in motion = { sway = [0, 1, 0], period = 4 }, got 3"],
    ),
    "motion without a period": (
        with_gate("motion = { sway = [0, 1, 0] }"),
        ["gate 1: motion: period is missing: how long it takes the gate to move to and fro, as in period = 4 [s]"],
    ),
    "motion with no period": (
        with_gate("motion = { sway = [0, 1, 0], period = 0 }"),
        ["gate 1: motion: period must be greater than 0, got 0"],
    ),
    "motion that does not end": (
        with_gate("motion = { sway = [0, inf, 0], period = 4 }"),
        ["gate 1: motion: sway y must be finite, got inf"],
    ),
    "sway along a line": (
        with_gate("motion = { sway = 1, period = 4 }"),
        ["gate 1: motion: sway must be three numbers [x, y, z], got 1"],
    ),
    "motion with a slip of the pen": (
        with_gate("motion = { swey = [0, 1, 0], period = 4 }"),
        ["gate 1: motion: unknown key 'swey'; did you mean 'sway'?"],
    ),
    "swing said twice": (
        with_gate("motion = { swing_deg = 20, swing_rad = 0.3, period = 4 }"),
        ["gate 1: motion: swing_deg and swing_rad are both given: keep one"],
    ),
    "motion that moves nothing": (
        with_gate("motion = { sway = [0, 0, 0], period = 4 }"),
        ["gate 1: motion: nothing moves: give sway, metres to either side along x, y, z, or swing_deg"],
    ),
    "swing all round": (
        with_gate("motion = { swing_deg = 90, period = 9 }"),
        ["gate 1: motion: swing_deg must be 0 to 60, to either side, got 90"],
    ),
    "swing to the other side": (
        with_gate("motion = { swing_deg = -20, period = 9 }"),
        ["gate 1: motion: swing_deg must be 0 to 60, to either side, got -20"],
    ),
    "gate that rushes": (
        with_gate("motion = { sway = [0, 2, 0], period = 1 }"),
        ["gate 1: motion: moves at up to 12.6 m/s, at most 5 m/s: a longer period, or less sway"],
    ),
    "gate that sinks into the ground": (
        with_gate("motion = { sway = [0, 0, 2.5], period = 8, phase_deg = 90 }"),
        ["gate 1: lies under ground: its centre is at z = -0.1651, must be above 0, 3.33 s into the race"],
    ),
    "gate that leaves the box": (
        with_gate("motion = { sway = [0, 4.5, 0], period = 9 }") + "[bounds]\nlow = [-5, -5, 0]\nhigh = [5, 5, 5]\n",
        ["gate 1: is out of bounds: reaches y = 5.347, bounds end at 5, 1.88 s into the race"],
    ),
    "gate that meets another": (
        with_gate("motion = { sway = [0, 4, 0], period = 9 }") + GATE.replace("[0, 0, 2]", "[0, 3.5, 2]"),
        ["gate 1: overlaps gate 2: their openings share room"],
    ),
    "gate that comes over a pole": (
        with_gate("motion = { sway = [0, 3, 0], period = 9 }") + POLE,
        ["pole 1: stands in the opening of gate 1"],
    ),
    "many faults at once": (
        "lap = 3\n" + NAME + GATE.replace("2]", "-2]") + SECOND + GATE.replace("yaw_deg = 0", 'width = "w"'),
        [
            "unknown key 'lap'; did you mean 'laps'?",
            "gate 3: width must be a number, got 'w'",
            "gate 3: yaw_deg is missing",
            "gate 1: lies under ground",
        ],
    ),
}

# name of the case: (content, what must be said)
UNREADABLE: dict[str, tuple[bytes, str]] = {
    "no value": (b"name =", "not TOML: Invalid value (at end of document)"),
    "broken line": (
        b'name = "a"\nlaps 3\n',
        "not TOML: Expected '=' after a key in a key/value pair (at line 2, column 6)",
    ),
    "key given twice": (b'name = "a"\nname = "b"\n', "not TOML: Cannot overwrite a value (at line 2, column 11)"),
    "array without end": (b"gates = [", "not TOML: "),
    "deeper than the parser": (b"gates = " + b"[" * 20_000, "not TOML: "),
    "number of 5000 digits": (b"laps = " + b"9" * 5000, "not TOML: "),
    "not UTF-8": (b'name = "\xff\xfe"', "not UTF-8 text: byte 8 cannot be read"),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(64), "not UTF-8 text: byte 0 cannot be read"),
    "zeros": (bytes(64), "not TOML: "),
    "too large": (b"#" * 1_000_001, "too large for a track file: more than 1000000 bytes"),
}
