"""Vehicle files with faults, for the reader and for the command."""

HEAVY = 'name = "heavy"\nbase = "racer"\nmass_kg = 1.0\n'
OWN = """name = "own"
mass_kg = 0.5
inertia_kg_m2 = [0.002, 0.002, 0.003]

[rotors]
offset_m = [0.1, 0.1]
torque_ratio_m = 0.02
max_thrust_n = 5.0
"""

# Content, and how its faults begin, in order.
MALFORMED: dict[str, tuple[str, tuple[str, ...]]] = {
    "nothing": (
        "",
        (
            "name is missing: the vehicle's name",
            "mass_kg is missing: its mass, as in",
            "inertia_kg_m2 is missing",
            "rotors: offset_m is missing",
            "rotors: torque_ratio_m is missing",
            "rotors: max_thrust_n is missing",
        ),
    ),
    "no name": ('base = "racer"\n', ("name is missing: the vehicle's name, as in name =",)),
    "typo": (HEAVY + "agilty_m_s2 = 30\n", ("unknown key 'agilty_m_s2'; did you mean 'agility_m_s2'?",)),
    "no unit": (HEAVY + "inertia = [1, 1, 1]\n", ("unknown key 'inertia'; did you mean 'inertia_kg_m2'?",)),
    "typo in a table": (
        HEAVY + "[rotors]\nmax_thrst_n = 5\n",
        ("rotors: unknown key 'max_thrst_n'; did you mean 'max_thrust_n'?",),
    ),
    "unknown table": (HEAVY + "[motors]\nkv = 2300\n", ("unknown key 'motors'; did you mean 'rotors'?",)),
    "text for a number": (HEAVY.replace("1.0", '"1 kg"'), ("mass_kg must be a number, got '1 kg'",)),
    "truth for a number": (HEAVY.replace("1.0", "true"), ("mass_kg must be a number, got true",)),
    "not finite": (HEAVY.replace("1.0", "nan"), ("mass_kg must be finite, got nan",)),
    "infinite": (HEAVY + "[rotors]\nmax_thrust_n = inf\n", ("rotors: max_thrust_n must be finite, got inf",)),
    "negative": (HEAVY.replace("1.0", "-1"), ("mass_kg must be greater than 0, got -1",)),
    "huge": (HEAVY.replace("1.0", "1e9"), ("mass_kg must lie within -1e+06 and 1e+06, got 1000000000.0",)),
    "two of three": (
        HEAVY + "inertia_kg_m2 = [1, 2]\n",
        ("inertia_kg_m2 must be three numbers [x, y, z], got 2 of them",),
    ),
    "one of three": (HEAVY + 'inertia_kg_m2 = [1, "a", 2]\n', ("inertia_kg_m2 y must be a number, got 'a'",)),
    "three of two": (
        HEAVY + "[rotors]\noffset_m = [1, 2, 3]\n",
        ("rotors: offset_m must be two numbers [forward, sideways], got 3",),
    ),
    "number for a table": (HEAVY + "rotors = 4\n", ("rotors must be a table [rotors], got 4",)),
    "array of tables": (HEAVY + "[[rotors]]\nmax_thrust_n = 5\n", ("rotors must be a table [rotors], got an array",)),
    "wrong word": (
        HEAVY + 'control = "thrust"\n',
        ("control must be one of acceleration, velocity, position, ctbr, attitude, got 'thrust'",),
    ),
    "wrong yaw": (HEAVY + '[attitude]\nyaw = "fast"\n', ("attitude: yaw must be one of rate, angle, got 'fast'",)),
    "half a step": (HEAVY + "substeps = 2.5\n", ("substeps must be a whole number, got 2.5",)),
    "many steps": (HEAVY + "substeps = 5000\n", ("substeps must be 1 to 1000, got 5000",)),
    "yes for true": (HEAVY + 'indoors = "yes"\n', ("indoors must be true or false, got 'yes'",)),
    "blank name": ('name = " "\nbase = "racer"\n', ("name must be printable text that is not blank",)),
    "unknown base": (
        'name = "x"\nbase = "racr"\n',
        ("base: unknown vehicle 'racr': did you mean 'racer'? built-in vehicles: paper",),
    ),
    "base is no text": ('name = "x"\nbase = 3\n', ("base must be the name of a built-in vehicle in quotes, got 3",)),
    "rotors for the paper's": (
        'name = "x"\nbase = "paper"\n[rotors]\nmax_thrust_n = 5\n',
        ("rotors: base 'paper' has no rotors: leave this table out",),
    ),
    "gains for a racer": (
        HEAVY + "[cascade]\nposition_p = 4\n",
        ("cascade: base 'racer' has no cascade: leave this table out",),
    ),
    "gains from nowhere": (OWN + "[cascade]\nposition_p = 4\n", ("cascade: only the paper's vehicle has these gains",)),
    "too heavy": (
        HEAVY.replace("1.0", "3.0"),
        (
            "agility (8.11483), the highest thrust per mass, must exceed gravity (9.81)",
            "four rotors of 6.08612 N at most do not lift its weight of 29.43 N",
        ),
    ),
    "weak": (
        OWN.replace("= 5.0", "= 1.0") + "[battery]\nfull_voltage_v = 3\nempty_voltage_v = 4\n",
        (
            "agility (8), the highest",
            "four rotors of 1 N at most do not lift",
            "empty_voltage (4.0) must not exceed full_voltage (3.0)",
        ),
    ),
    "upside down": (
        HEAVY + "[attitude]\nmax_tilt_rad = 1.6\n",
        ("highest_tilt must be above 0 and below 1.5708, not 1.6",),
    ),
    "least above most": (HEAVY + "[rotors]\nmin_thrust_n = 7\n", ("min_thrust (7.0) must be below max_thrust",)),
    "paper by attitude": (
        'name = "x"\nbase = "paper"\ncontrol = "attitude"\n',
        ("has no airframe that follows attitude and thrust: its control must be",),
    ),
    "a name that is taken": (
        'name = "racer"\nbase = "racer"\nmass_kg = 1.0\n',
        ("name 'racer' is that of a built-in vehicle with other numbers",),
    ),
    "two faults": (
        HEAVY + "gravity_m_s2 = 0\n[drag]\nhorizontal_kg_s = -1\n",
        ("gravity_m_s2 must be greater than 0, got 0", "drag: horizontal_kg_s must be at least 0, got -1"),
    ),
}

UNREADABLE: dict[str, tuple[bytes, str]] = {
    "not TOML": (b"name = = 1", "not TOML: "),
    "not UTF-8": (b'name = "\xff"', "not UTF-8 text: byte 8"),
    "deep": (b"a = " + b"[" * 100_000, "not TOML: "),
    "too large": (b"#" * 1_000_001, "too large for a vehicle file: more than 1000000 bytes"),
}
