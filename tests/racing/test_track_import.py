"""Tracks of other programs: those that are built in come back from their files, and bad files give one line."""

import dataclasses
import math

import pytest
import yaml

from cruise.cli.main import main
from cruise.errors import CruiseError
from cruise.presets import TRACKS
from cruise.racing.track_file import load_track
from cruise.racing.track_import import import_track

LSY_GATES = [(0.5, 0.25, 0.7, -0.78), (1.05, 0.75, 1.2, 2.35), (-1.0, -0.25, 0.7, 3.14), (0.0, -0.75, 1.2, 0.0)]
LSY_POLES = [(0.0, 0.75), (1.0, 0.25), (-1.5, -0.25), (-0.5, -0.75)]


def lsy(**changes):
    """The part of a configuration that a track is; `changes` replace whole lines."""
    lines = {"head": "[env]\nfreq = 50\n[env.track]\nrandomize = false"}
    for n, (x, y, z, yaw) in enumerate(LSY_GATES):
        lines[f"gate{n}"] = f"[[env.track.gates]]\npos = [{x}, {y}, {z}]\nrpy = [0.0, 0.0, {yaw}]"
    for n, (x, y) in enumerate(LSY_POLES):
        lines[f"pole{n}"] = f"[[env.track.obstacles]]\npos = [{x}, {y}, 1.55]"
    lines["drone"] = "[[env.track.drones]]\npos = [-1.5, 0.75, 0.01]\nrpy = [0, 0, 0]\nvel = [0, 0, 0]"
    return "\n".join((lines | changes).values()) + "\n"


def marl(**changes):
    """The track of 2026; a change of None leaves a key out."""
    gates = {}
    for n, gate in enumerate(TRACKS["uzh-2026"].gates, start=1):
        half = gate.yaw / 2
        rotation = [round(math.cos(half), 7), 0.0, 0.0, round(math.sin(half), 7)]
        gates[f"Gate{n}"] = {"position": list(gate.position_w), "rotation": rotation, "size": [0.4, 1.5, 1.5]}
    start = [math.cos(math.pi / 8), 0, 0, -math.sin(math.pi / 8)]
    document = {"gates": gates | {"N": 7}, "start_pos": [-5.0, 4.7, 0.61], "start_attitude": start}
    document |= {"world_box": [-10.0, -8.0, 0.05, 14.0, 9.0, 6.0], "loop": True}
    return yaml.safe_dump({key: value for key, value in (document | changes).items() if value is not None})


def gates_of(**changes):
    """The table of gates of `marl` with some of gate 2 changed."""
    gates = yaml.safe_load(marl())["gates"]
    return gates | {"Gate2": gates["Gate2"] | changes}


def cpc(**changes):
    """Two laps and five gates of the split-S, and the end, which is the next gate."""
    lap = [list(gate.position_w) for gate in TRACKS["split-s"].gates]
    document = {"gates": (3 * lap)[:19], "initial": {"position": [-5, 4.5, 1.2]}, "end": {"position": lap[5]}}
    return yaml.safe_dump(document | changes)


def write(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


def test_munichs_configuration_is_the_track_that_is_built_in(tmp_path):
    assert import_track(write(tmp_path, "level2.toml", lsy()), "lsy-2") == TRACKS["lsy-2"]


def test_zurichs_track_is_the_one_that_is_built_in(tmp_path):
    """But for the start, of which its file has one place alone, and digits beyond a file's."""
    track, built_in = import_track(write(tmp_path, "track.yaml", marl()), "uzh-2026"), TRACKS["uzh-2026"]
    for gate, known in zip(track.gates, built_in.gates, strict=True):
        assert gate == dataclasses.replace(known, yaw=gate.yaw)
        assert math.remainder(gate.yaw - known.yaw, math.tau) == pytest.approx(0, abs=1e-6)
    assert (track.bounds_low, track.bounds_high, track.frame_width) == ((-10, -8, 0), (14, 9, 6), built_in.frame_width)
    assert track.start.places[0].position_w == pytest.approx(built_in.start.places[0].position_w)
    assert track.start.places[0].yaw == pytest.approx(math.radians(-45), abs=1e-6)


def test_a_planners_laps_are_one_lap(tmp_path):
    """Places of the split-S; headings, which the file does not have, within 15 degrees but for gates 2 and 5."""
    track = import_track(write(tmp_path, "track.yaml", cpc()), opening=1.5)
    known = TRACKS["split-s"].gates
    assert [gate.position_w for gate in track.gates] == [gate.position_w for gate in known]
    assert all(gate.width == 1.5 for gate in track.gates)
    off = [abs(math.degrees(math.remainder(a.yaw - b.yaw, math.tau))) for a, b in zip(track.gates, known, strict=True)]
    assert [n for n, angle in enumerate(off, start=1) if angle > 15] == [2, 5]
    assert track.start.places[0].position_w == (-5.0, 4.5, 1.2)


def test_the_command_writes_a_track_file(tmp_path, capsys):
    source, out = write(tmp_path, "level2.toml", lsy()), tmp_path / "mine.toml"
    assert main(["tracks", "import", str(source), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"track {out}\nlevel2: 4 gates, 5.68 m a lap, 1 lap\n"
    assert load_track(out) == dataclasses.replace(TRACKS["lsy-2"], name="level2")


GATE = "[[env.track.gates]]\npos = [0.5, 0.25, 0.7]\nrpy = [0, 0, 0]"
# name of the case: (name of the file, its text, the one line after its path)
BAD = {
    "another ending": ("track.json", "{}", ": tracks are imported from .toml, .yaml and .yml files"),
    "not TOML": ("t.toml", "[env", ": not TOML: "),
    "another TOML": ("t.toml", 'name = "mine"\n', ": no known track: [env.track] is lsy_drone_racing's"),
    "track that is a number": ("t.toml", "[env]\ntrack = 3\n", " (lsy_drone_racing): env.track must be a table, got 3"),
    "no gates": ("t.toml", "[env.track]\nrandomize = true\n", " (lsy_drone_racing): gates must be 1 to 200, got 0"),
    "gates that are a table": (
        "t.toml",
        "[env.track]\ngates = {pos = 1}\n",
        " (lsy_drone_racing): gates must be an array of tables, got a table",
    ),
    "no angles": (
        "t.toml",
        lsy(gate1="[[env.track.gates]]\npos = [1, 1, 1]"),
        " (lsy_drone_racing): gate 2: rpy is missing",
    ),
    "two angles": (
        "t.toml",
        lsy(gate0=GATE.replace("[0, 0, 0]", "[0, 0]")),
        " (lsy_drone_racing): gate 1: rpy must be three numbers [roll, pitch, yaw], got 2 of them",
    ),
    "a place of text": (
        "t.toml",
        lsy(pole2='[[env.track.obstacles]]\npos = ["a", 0, 1]'),
        " (lsy_drone_racing): obstacle 3: pos x must be a number, got 'a'",
    ),
    "an infinite place": (
        "t.toml",
        lsy(gate0=GATE.replace("0.7", "inf")),
        " (lsy_drone_racing): gate 1: pos z must be finite, got inf",
    ),
    "no drone": ("t.toml", lsy(drone=""), " (lsy_drone_racing): drones must be 1 to 200, got 0"),
    "a gate under ground": (
        "t.toml",
        lsy(gate0=GATE.replace("0.7", "-0.7")),
        " (lsy_drone_racing): gate 1: lies under ground: its centre is at z = -0.7, must be above 0",
    ),
    "not YAML": ("t.yaml", "gates: [1, 2", ": not YAML: "),
    "code in YAML": ("t.yaml", "gates: !!python/object/apply:os.system ['true']", ": not YAML: could not determine"),
    "a list": ("t.yaml", "- 1\n- 2\n", ": holds an array in place of keys such as gates"),
    "an empty file": ("t.yaml", "", ": holds nothing in place of keys such as gates"),
    "another YAML": ("t.yml", "walls: 3\n", ": no known track: "),
    "how many gates": (
        "t.yaml",
        marl(gates={"Gate1": 1}),
        " (marl-racing): gates: N is missing: how many gates there are",
    ),
    "half a gate": ("t.yaml", marl(gates={"N": 1.5}), " (marl-racing): gates: N must be a whole number, got 1.5"),
    "a gate that is not there": (
        "t.yaml",
        marl(gates=gates_of() | {"N": 8}),
        " (marl-racing): gates: Gate8 is missing, of 8",
    ),
    "a gate that is a number": (
        "t.yaml",
        marl(gates={"Gate1": 3, "N": 1}),
        " (marl-racing): gate 1: must be a table, got 3",
    ),
    "a long quaternion": (
        "t.yaml",
        marl(gates=gates_of(rotation=[1, 0, 0, 1])),
        " (marl-racing): gate 2: rotation must be a quaternion of length 1, got one of 1.414",
    ),
    "three numbers of four": (
        "t.yaml",
        marl(gates=gates_of(rotation=[1, 0, 0])),
        " (marl-racing): gate 2: rotation must be 4 numbers [w, x, y, z], got 3 of them",
    ),
    "no size": (
        "t.yaml",
        marl(gates=gates_of(size=[0.4, 0, 1.5])),
        " (marl-racing): gate 2: size width must be greater than 0, got 0",
    ),
    "no start": ("t.yaml", marl(start_pos=None), " (marl-racing): start_pos is missing: where a drone waits"),
    "no box": ("t.yaml", marl(world_box=None), " (marl-racing): world_box is missing: the corners of the room"),
    "a box upside down": (
        "t.yaml",
        marl(world_box=[-10, -8, 7, 14, 9, 6]),
        " (marl-racing): world_box must have a lower z first",
    ),
    "a start outside": (
        "t.yaml",
        marl(start_pos=[40, 0, 1]),
        " (marl-racing): start: place 1 at (40, 0, 1) lies outside the track, under ground or in a solid",
    ),
    "no places": ("t.yaml", cpc(gates=[]), " (rpg_time_optimal): gates must be 1 to 200 places, got 0"),
    "a flat place": (
        "t.yaml",
        cpc(gates=[[1, 2]]),
        " (rpg_time_optimal): gate 1: must be three numbers [x, y, z], got 2 of them",
    ),
    "a place that is true": (
        "t.yaml",
        cpc(gates=[[1, 2, True]]),
        " (rpg_time_optimal): gate 1: z must be a number, got true",
    ),
    "an end that is a list": ("t.yaml", cpc(end=[1, 2, 3]), " (rpg_time_optimal): end must be a table, got an array"),
    "a start that is a word": (
        "t.yaml",
        cpc(initial={"position": "here"}),
        " (rpg_time_optimal): initial: position must be three numbers [x, y, z], got 'here'",
    ),
    "gates in one place": (
        "t.yaml",
        cpc(gates=[[0, 0, 2], [0, 0, 2.3], [9, 0, 2]], initial=None, end=None),
        " (rpg_time_optimal): gate 1: overlaps gate 2",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_gives_one_line(case, tmp_path):
    name, text, line = BAD[case]
    path = write(tmp_path, name, text)
    with pytest.raises(CruiseError) as caught:
        import_track(path)
    assert str(caught.value).startswith(f"{path}{line}")
    assert "\n" not in str(caught.value)


def test_what_is_no_file_or_no_opening(tmp_path, capsys):
    assert main(["tracks", "import", str(tmp_path / "no.yaml"), "--out", str(tmp_path / "o.toml")]) == 2
    assert "no such track file" in capsys.readouterr().err
    source = write(tmp_path, "t.yaml", cpc())
    assert main(["tracks", "import", str(source), "--out", str(tmp_path / "o.toml"), "--opening", "-1"]) == 2
    assert "the opening of gates must be greater than 0, got -1.0" in capsys.readouterr().err
    assert not (tmp_path / "o.toml").exists()
