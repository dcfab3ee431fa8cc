"""Race logs: what is written is read, by anyone, and what is not sound is refused."""

import dataclasses
import io
import os
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.storage.race_log import COLLISIONS, EVENT_KINDS, RaceLog, load_race_log
from tests.storage.logs import small_log

DOCUMENTATION = Path(__file__).parents[2] / "docs" / "race-log.md"


def arrays_of(log):
    return {field.name: np.asarray(getattr(log, field.name)) for field in dataclasses.fields(log)}


def test_round_trip(tmp_path):
    log, path = small_log(), tmp_path / "race.npz"
    log.save(path)
    assert os.listdir(tmp_path) == ["race.npz"]
    loaded = load_race_log(path)
    for name, value in arrays_of(log).items():
        again = np.asarray(getattr(loaded, name))
        assert again.dtype == value.dtype
        np.testing.assert_array_equal(again, value)
    assert (loaded.num_drones, loaded.num_gates, loaded.gates_to_finish) == (2, 3, 7)
    assert isinstance(loaded.laps, int)


def test_anyone_can_read_it_and_the_bytes_depend_on_the_race_alone(tmp_path):
    for name in ("a.npz", "b.npz"):
        small_log().save(tmp_path / name)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        assert set(file.files) == {field.name for field in dataclasses.fields(RaceLog)}
        assert all(file[name].dtype != object for name in file.files)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_logs_of_before_there_were_ellipsoids_are_read(tmp_path):
    old = {name: value for name, value in arrays_of(small_log()).items() if name != "collision_aspect"}
    np.savez(tmp_path / "race.npz", **old)
    assert load_race_log(tmp_path / "race.npz").collision_aspect == 1.0


def test_kinds_of_events_are_stored_by_name(tmp_path):
    """Whatever number a kind had when its log was written, the names in the file say what it is."""
    log = small_log()
    order = np.random.default_rng(0).permutation(len(EVENT_KINDS))
    number = np.argsort(order).astype(np.int32)  # of every kind, in the file
    arrays = arrays_of(log) | {"event_kind": number[log.event_kind], "event_kind_names": np.array(EVENT_KINDS)[order]}
    np.savez(tmp_path / "race.npz", **arrays)
    np.testing.assert_array_equal(load_race_log(tmp_path / "race.npz").event_kind, log.event_kind)


FIRST_COLLISIONS = tuple(f"collision_{what}" for what in ("drone", "ground", "gate_frame", "bounds", "flip"))
FIRST_KINDS = ("crossing", "missed_gate", *FIRST_COLLISIONS, "finish")


def test_logs_of_the_first_format_are_read(tmp_path):
    """Eight kinds of event by number, no tilt, no shapes, no solids."""
    new = ("gate_roll", "gate_pitch", "gate_shape", "solid_")
    arrays = {name: value for name, value in arrays_of(small_log()).items() if not name.startswith(new)}
    kinds = ["crossing", "finish", "collision_flip", "collision_drone"]
    numbers = np.array([FIRST_KINDS.index(kind) for kind in kinds], np.int32)
    arrays |= {"event_kind": numbers, "event_kind_names": np.array(FIRST_KINDS)}
    np.savez(tmp_path / "race.npz", **arrays | {"version": 1})
    log = load_race_log(tmp_path / "race.npz")
    assert log.event_kind_names[log.event_kind].tolist() == kinds
    assert (log.gate_roll == 0).all()
    assert log.gate_shape.tolist() == ["rectangle"] * 3
    assert log.solid_position.shape == (0, 3)


def test_no_events_is_a_race_too(tmp_path):
    log = small_log(
        **{name: getattr(small_log(), name)[:0] for name in vars(small_log()) if re.match("event_[^k]", name)}
    )
    log = dataclasses.replace(log, event_kind=log.event_drone)
    log.save(tmp_path / "race.npz")
    assert len(load_race_log(tmp_path / "race.npz").event_time) == 0


def test_every_array_and_kind_is_documented():
    text = DOCUMENTATION.read_text()
    documented = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", text, re.MULTILINE)
    names = {name for cell in documented for name in re.findall(r"`(\w+)`", cell)}
    assert {field.name for field in dataclasses.fields(RaceLog)} | set(EVENT_KINDS) <= names


def with_array(**changes):
    """Bytes of a log with arrays replaced, or left out where None."""
    arrays = arrays_of(small_log()) | changes
    buffer = io.BytesIO()
    np.savez(buffer, **{name: array for name, array in arrays.items() if array is not None})
    return buffer.getvalue()


def bent(name, index, value):
    array = np.array(arrays_of(small_log())[name])
    array[index] = value
    return with_array(**{name: array})


WHOLE = with_array()
MALFORMED = {
    "empty": (b"", "not a readable .npz file"),
    "cut short": (WHOLE[: len(WHOLE) // 2], "not a readable .npz file"),
    "text": (b"time,x,y\n0,1,2\n", "not a readable .npz file"),
    "pickle": (pickle.dumps({"time": [0.0]}), "not a readable .npz file"),
    "one array": (np.arange(3.0).tobytes(), "not a readable .npz file"),
    "objects": (with_array(pilots=np.array([None, None])), "not a readable .npz file"),
    "missing": (with_array(velocity_w=None), "lacks array 'velocity_w'"),
    "missing number": (with_array(laps=None), "lacks array 'laps'"),
    "integers for floats": (with_array(time=np.arange(5)), "array 'time' holds int64, expected floats"),
    "floats for flags": (with_array(airborne=np.ones((5, 2))), "array 'airborne' holds float64, expected booleans"),
    "numbers for names": (with_array(pilots=np.arange(2)), "array 'pilots' holds int64, expected text"),
    "too few axes": (with_array(position_w=np.ones((5, 6))), "'position_w' has shape [5, 6], expected [5, N, 3]"),
    "two coordinates": (with_array(euler=np.ones((5, 2, 2))), "'euler' has shape [5, 2, 2], expected [5, 2, 3]"),
    "other length": (with_array(velocity_w=np.ones((4, 2, 3))), "'velocity_w' has shape [4, 2, 3], expected [5, 2, 3]"),
    "events of other length": (with_array(event_gate=np.zeros(3, int)), "'event_gate' has shape [3], expected [4]"),
    "pilot too few": (with_array(pilots=np.array(["a"])), "'pilots' has shape [1], expected [2]"),
    "NaN": (bent("position_w", (1, 1, 1), np.nan), "'position_w' holds numbers that are not finite"),
    "infinity": (bent("gate_yaw", 0, np.inf), "'gate_yaw' holds numbers that are not finite"),
    "no such gate": (bent("next_gate", (0, 0), 3), "'next_gate' holds numbers outside 0 .. 2"),
    "no such drone": (bent("event_drone", 0, 2), "'event_drone' holds numbers outside 0 .. 1"),
    "no such kind": (
        bent("event_kind", 0, len(EVENT_KINDS)),
        f"'event_kind' holds numbers outside 0 .. {len(EVENT_KINDS) - 1}",
    ),
    "no such other": (bent("event_other", 0, -2), "'event_other' holds numbers outside -1 .. 1"),
    "other kinds": (
        with_array(event_kind_names=np.array(["applause"] * len(EVENT_KINDS))),
        "'event_kind_names' holds 'applause'; known",
    ),
    "time stands still": (bent("time", 2, 0.1), "'time' does not ascend"),
    "events in disorder": (bent("event_time", 0, 0.2), "'event_time' does not ascend within the race"),
    "event after the end": (bent("event_time", 3, 9.0), "'event_time' does not ascend within the race"),
    "no laps": (with_array(laps=np.array(0)), "'laps' must be above 0, got 0"),
    "no time step": (with_array(control_dt=np.array(-0.1)), "'control_dt' must be above 0, got -0.1"),
    "future version": (with_array(version=np.array(3)), "format version 3, this program reads up to 2"),
    "no samples": (
        with_array(**{n: a[:0] for n, a in arrays_of(small_log()).items() if a.ndim and len(a) == 5}),
        "has no samples",
    ),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed(case, tmp_path):
    content, message = MALFORMED[case]
    path = tmp_path / "race.npz"
    path.write_bytes(content)
    with pytest.raises(CruiseError) as error:
        load_race_log(path)
    assert str(error.value).startswith(f"race log {path}: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_no_file(tmp_path):
    with pytest.raises(CruiseError, match=r"^race log .*none.npz does not exist$"):
        load_race_log(tmp_path / "none.npz")


def test_collisions_are_kinds_of_events():
    assert set(COLLISIONS) < set(EVENT_KINDS)
    assert len(COLLISIONS) == 7
