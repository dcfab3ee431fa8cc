"""Track files: every fault is named, a saved track comes back equal, nothing is half written."""

import itertools
import math
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from cruise.config import Gate, Pole, StartLine, StartPlace, StartPlaces, Track, Wall
from cruise.errors import CruiseError
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.track_file import (
    document_faults,
    load_track,
    read_document,
    save_track,
    track_faults,
    track_warnings,
)
from cruise.racing.track_geometry import FARTHEST, lap_length, segment_lengths
from tests.racing.track_tables import GATE, MALFORMED, NAME, SECOND, SOUND, THIRD, UNREADABLE

EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "tracks").glob("*.toml"))


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "track.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("case", MALFORMED)
def test_every_fault_is_named(case, tmp_path):
    content, expected = MALFORMED[case]
    path = write(tmp_path, content)
    faults = document_faults(read_document(path))
    for text in expected:
        assert any(fault.startswith(text) for fault in faults), faults
    assert len(faults) == len(expected), faults
    with pytest.raises(CruiseError) as caught:
        load_track(path)
    assert str(caught.value).startswith(f"{path}: {faults[0]}")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("case", UNREADABLE)
def test_unreadable_content_is_refused(case, tmp_path):
    content, expected = UNREADABLE[case]
    path = write(tmp_path, content)
    with pytest.raises(CruiseError) as caught:
        load_track(path)
    assert str(caught.value).startswith(f"{path}: {expected}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (
            "rnig",
            "unknown track 'rnig': did you mean 'ring'? built-in tracks: ring, figure-eight, split-s, a2rl-2025, ",
        ),
        ("Figure_Eight", "unknown track 'Figure_Eight': did you mean 'figure-eight'? built-in tracks"),
        (
            "monza",
            "unknown track 'monza': built-in tracks: ring, figure-eight, split-s, a2rl-2025, delft-eight, uzh-2026, ",
        ),
        ("", "unknown track ''"),
        ("a\nb", "unknown track 'a\\nb'"),
        ("missing.toml", "missing.toml: no such track file"),
        ("./ring", "./ring: no such track file"),
        (Path("ring"), "ring: no such track file"),
        ("nothing/here.toml", "nothing/here.toml: no such track file"),
        ("a\0b", "unknown track 'a\\x00b'"),
        ("x" * 300, "unknown track 'xxx"),
    ],
)
def test_missing_tracks_are_named(name, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CruiseError) as caught:
        load_track(name)
    assert str(caught.value).startswith(expected)


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(CruiseError, match="is a directory, not a track file"):
        load_track(tmp_path)
    with pytest.raises(CruiseError, match="is not a regular file"):
        load_track(tmp_path / "pipe.toml")


@pytest.mark.parametrize("name", TRACKS)
def test_built_in_tracks_have_no_faults(name, tmp_path):
    track = load_track(name)
    assert track is TRACKS[name]
    assert track_faults(track) == []
    save_track(track, tmp_path / "track.toml")
    assert load_track(tmp_path / "track.toml") == track


def test_lengths_are_the_papers():
    assert lap_length(TRACKS["ring"].gates) == pytest.approx(58.95, abs=0.01)
    assert lap_length(TRACKS["figure-eight"].gates) == pytest.approx(56.8, abs=0.05)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_have_no_faults(path):
    assert load_track(path).name == path.stem


def test_defaults(tmp_path):
    track = load_track(write(tmp_path, NAME + GATE + SECOND.replace("12", "40")))
    assert track.gates == (Gate((0.0, 0.0, 2.0), 0.0, 2.0, 2.0), Gate((40.0, 0.0, 2.0), 0.0, 2.0, 2.0))
    assert (track.laps, track.frame_width) == (3, 0.3)
    assert (track.bounds_low, track.bounds_high) == ((-10.0, -11.0, 0.0), (50.0, 11.0, 13.0))
    assert track.leave_distance == 40.0, "a drone half way between two gates has not left the track"
    assert type(track.gates[0].yaw) is float


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(SOUND, id="one gate"),
        pytest.param(NAME + GATE + SECOND.replace("yaw_deg = 0", "yaw_deg = 180"), id="two gates, to and fro"),
        pytest.param(NAME + GATE + SECOND, id="two gates, one way"),
        pytest.param(NAME + GATE + SECOND + THIRD, id="three gates"),
        pytest.param(NAME + GATE.replace("0, 0, 2", "0, 0, 0.5"), id="opening partly under ground"),
        pytest.param("\N{ZERO WIDTH NO-BREAK SPACE}" + SOUND, id="byte order mark"),
        pytest.param(SOUND.replace("\n", "\r\n"), id="lines of another system"),
        pytest.param("frame_width = 0\n" + NAME + GATE + GATE.replace("0, 0, 2", "0, 0, 4"), id="one above the other"),
        pytest.param(NAME + GATE + "width = 60\n", id="opening wider than the margin"),
    ],
)
def test_unusual_tracks_are_sound(content, tmp_path):
    track = load_track(write(tmp_path, content))
    assert track_faults(track) == []
    assert len(segment_lengths(track.gates)) == len(track.gates)


@pytest.mark.parametrize("yaw_deg", [89, -89, 90])
def test_a_gate_may_be_flown_aslant(yaw_deg, tmp_path):
    row = NAME + "".join(
        f"[[gates]]\nposition = [{x}, {y}, 2]\nyaw_deg = {yaw}\n"
        for x, y, yaw in [(0, 0, 0), (10, 0, yaw_deg), (20, 0, 0), (10, 30, 180)]
    )
    faults = document_faults(read_document(write(tmp_path, row)))
    assert faults == []


FRAMES_APART = "gate 1: its frame overlaps that of gate 2, openings apart"


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        pytest.param(NAME + GATE + SECOND.replace("12, 0", "0, 2.5"), [FRAMES_APART], id="frames"),
        pytest.param(NAME + GATE + SECOND.replace("12, 0", "0, 2.7"), [], id="apart"),
        pytest.param(
            NAME + GATE + SECOND + "[bounds]\nlow = [-1.55, -3, 0]\nhigh = [30, 30, 9]\n",
            ["gate 1: has no room for a start grid of 4 drones: no race starts there"],
            id="a wall behind",
        ),
    ],
)
def test_what_is_no_fault_is_a_warning(content, expected, tmp_path):
    track = load_track(write(tmp_path, content))
    assert track_warnings(track) == expected


def test_zurichs_track_is_raced_though_two_of_its_frames_overlap():
    track = TRACKS["uzh-2026"]
    assert track_faults(track) == []
    assert track_warnings(track) == ["gate 4: its frame overlaps that of gate 5, openings apart"]
    assert track.start.places[0].position_w == pytest.approx((-5.0, 4.7, 0.61))
    apart = [math.dist(a.position_w, b.position_w) for a, b in itertools.combinations(track.start.places, 2)]
    assert min(apart) == pytest.approx(1.0, abs=2e-3)  # along the arc


def test_munichs_course_has_its_stands_and_poles():
    """All of it bigger by what a drone takes up, 0.07 m, or 0.1 m at the sides of gates that stand across its box."""
    track = TRACKS["lsy-2"]
    assert track_faults(track) == []
    stands = [solid for solid in track.obstacles if isinstance(solid, Wall)]
    tops = [stand.position_w[2] + stand.size[2] / 2 for stand in stands]
    assert tops == pytest.approx([gate.position_w[2] - 0.36 + 0.07 for gate in track.gates])
    assert [gate.width / 2 for gate in track.gates] == pytest.approx([0.101, 0.101, 0.13, 0.13], abs=2e-4)
    assert {gate.height / 2 for gate in track.gates} == {0.13}
    assert min(gate.height / 2 for gate in track.gates) + track.frame_width >= 0.36 + 0.07
    assert sum(isinstance(solid, Pole) for solid in track.obstacles) == 4


def test_a_gate_that_faces_across_the_flight_is_a_warning():
    """Gate 6 of Pennsylvania's walled track is flown against the way that leads on."""
    assert track_faults(TRACKS["upenn-walls"]) == []
    assert any(text.startswith("gate 6: faces away") for text in track_warnings(TRACKS["upenn-walls"]))


SOLIDS = (Pole((12.0, 3.0, 0.0), 4.0, 0.1), Wall((14.0, -3.0, 1.0), (2.0, 0.2, 2.0), yaw=0.5))
STARTS = {
    "places": StartPlaces((StartPlace((-3.0, 0.0, 1.0), 0.25), StartPlace((-3.0, 2.0, 1.0), -0.5))),
    "line": StartLine((-3.0, 0.0, 1.0), 0.1, 0.8),
}


@pytest.mark.parametrize("kind", STARTS)
def test_tilt_shapes_solids_and_starts_come_back_equal(kind, tmp_path):
    gates = (
        Gate((0.0, 0.0, 2.0), 0.0, roll=0.7, pitch=-math.pi / 4),
        Gate((8.0, 0.0, 2.0), 0.3, 1.5, 1.5, shape="round"),
        Gate((4.0, 9.0, 3.0), math.pi, 1.0, 2.0, pitch=0.1),
    )
    high = (30.0, 30.0, 9.0)
    where = {"obstacles": SOLIDS, "start": STARTS[kind], "start_gate": 2, "finish": "last", "frame_depth": 0.1}
    track = Track("all", gates, (-9.0, -9.0, 0.0), high, **where)
    assert track_faults(track) == []
    save_track(track, tmp_path / "track.toml")
    assert load_track(tmp_path / "track.toml") == track


FINITE, LENGTH = st.floats(-300, 300), st.floats(0.01, 50)
GATE_FIELDS = st.tuples(st.tuples(FINITE, FINITE, st.floats(0.1, 300)), st.floats(-1e3, 1e3), LENGTH, LENGTH)
TRACK_FIELDS = st.fixed_dictionaries(
    {
        "name": st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1),
        "bounds_low": st.tuples(st.floats(-9000, -400), st.floats(-9000, -400), st.floats(-100, 0)),
        "bounds_high": st.tuples(*[st.floats(400, 9000)] * 3),
        "laps": st.integers(1, 1000),
        "frame_width": st.floats(0, 1),
        "leave_distance": st.floats(2000, 9000),
    }
)


@settings(max_examples=60)
@given(gates=st.lists(GATE_FIELDS, min_size=1, max_size=3), fields=TRACK_FIELDS)
def test_a_saved_track_comes_back_equal(gates, fields, tmp_path_factory):
    track = Track(gates=tuple(Gate(*gate) for gate in gates), **fields)
    assume(not track_faults(track))
    path = tmp_path_factory.getbasetemp() / "saved.toml"
    save_track(track, path)
    assert load_track(path) == track


@given(yaw=st.floats(-1e4, 1e4))
def test_every_yaw_comes_back(yaw, tmp_path_factory):
    track = Track("one", (Gate((0.0, 0.0, 2.0), yaw),), (-9.0, -9.0, 0.0), (9.0, 9.0, 9.0))
    path = tmp_path_factory.getbasetemp() / "yaw.toml"
    save_track(track, path)
    assert load_track(path).gates[0].yaw == yaw


@settings(max_examples=100, suppress_health_check=list(HealthCheck))
@given(
    data=st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.sampled_from(["name", "gates", "bounds", "low", "high", "position", "yaw_deg", "width"]), inner
            )
        ),
    )
)
def test_any_document_is_judged_without_a_crash(data):
    document = data if isinstance(data, dict) else {"gates": data}
    assert all(fault.isprintable() for fault in document_faults(document))


def test_faults_of_a_track_made_in_python():
    ring = TRACKS["ring"]
    gates = (replace(ring.gates[0], width=math.nan), *ring.gates[1:4], replace(ring.gates[4], yaw=math.radians(198)))
    track = replace(ring, gates=gates, laps=0, bounds_high=(-20.0, 20.0, math.inf))
    assert track_faults(track) == [
        "laps must be 1 to 1000, got 0",
        "bounds: high z must be finite, got inf",
        "gate 1: width must be finite, got nan",
    ]


def test_errors_name_the_first_faults_and_count_the_rest(tmp_path):
    path = write(tmp_path, NAME + "[[gates]]\nwidth = -1\nheight = 0\nsize = 3\n")
    with pytest.raises(CruiseError) as caught:
        load_track(path)
    assert str(caught.value).count("gate 1: ") == 3
    assert str(caught.value).endswith("; and 2 more (see `cruise tracks check`)")


def test_a_faulty_track_is_not_saved(tmp_path):
    with pytest.raises(CruiseError, match="track 'ring': laps must be 1 to 1000, got 0"):
        save_track(replace(TRACKS["ring"], laps=0), tmp_path / "track.toml")
    assert list(tmp_path.iterdir()) == []


def test_saving_is_whole_or_not_at_all(tmp_path, monkeypatch):
    path = write(tmp_path, "before")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(CruiseError, match=r"track\.toml: cannot be written: No space left on device"):
        save_track(TRACKS["ring"], path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["track.toml"]
    assert path.read_text() == "before"
    with pytest.raises(CruiseError, match="cannot be written: No such file or directory"):
        save_track(TRACKS["ring"], tmp_path / "no" / "track.toml")


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="nothing is unreadable to root")
def test_unreadable_file(tmp_path):
    path = write(tmp_path, SOUND)
    path.chmod(0)
    with pytest.raises(CruiseError, match="cannot be read: Permission denied"):
        load_track(path)


def test_a_slow_drone_moves_at_the_farthest_gate_that_is_accepted():
    """In single precision, at 0.1 m/s for a second, along an axis: where a track may lie, not where it may not."""
    racer = VEHICLES["racer"]
    for place, moves in ((FARTHEST, True), (9900.0, False)):
        step = np.float32(0.1 * racer.control_dt / racer.substeps)
        x = start = np.float32(place)
        for _ in range(round(1 / racer.control_dt) * racer.substeps):
            x = np.float32(x + step)
        assert (abs(float(x) - float(start) - 0.1) < 0.02) == moves
        gate = Gate((place, 0.0, 2.0), 0.0)
        track = Track("far", (gate,), (place - 20, -20.0, 0.0), (place + 20, 20.0, 20.0))
        assert (track_faults(track) == []) == moves
