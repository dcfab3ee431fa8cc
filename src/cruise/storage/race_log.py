"""A race as data: plain arrays in one `.npz` file, described in `docs/race-log.md`."""

import dataclasses
import io
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cruise.config import gates_to_finish
from cruise.errors import CruiseError, one_line
from cruise.racing.events import COLLISIONS, EVENT_KINDS, EventKind
from cruise.storage.atomic import read_bytes, write_atomically

FORMAT_VERSION = 2  # 1: no tilt, shape and solids


__all__ = ["COLLISIONS", "EVENT_KINDS", "NOBODY", "EventKind", "RaceLog", "load_race_log"]
PERIOD = 4  # of a gate that moves: its column in `gate_motion`; 0: it stands still
NOBODY = -1  # in `event_gate` and `event_other`: none


def flown_in(pilots: Sequence[str], vehicles: Sequence[str]) -> tuple[str, ...]:
    """What tells drones apart: their pilots' names, where vehicles differ with those."""
    if len(set(vehicles)) == 1:
        return tuple(map(str, pilots))
    return tuple(f"{pilot} ({vehicle})" for pilot, vehicle in zip(pilots, vehicles, strict=True))


@dataclass(frozen=True)
class RaceLog:
    """One race. T samples, N drones, G gates, A numbers an action has, V events; world frame, z up.

    Sample 0 is the standing start. A drone that is not `airborne` at a sample is out or has finished: it stands still
    in the log where it ended, and obstructs nobody.
    """

    time: np.ndarray  # [T] s
    position_w: np.ndarray  # [T, N, 3] m
    velocity_w: np.ndarray  # [T, N, 3] m/s
    euler: np.ndarray  # [T, N, 3] roll, pitch, yaw (ZYX), rad
    action: np.ndarray  # [T, N, A] held from this sample to the next; zero at the last and where not airborne
    next_gate: np.ndarray  # [T, N] index of the gate to pass next
    airborne: np.ndarray  # [T, N] still racing
    gate_position: np.ndarray  # [G, 3] centres of the openings, m
    gate_yaw: np.ndarray  # [G] heading of the direction of flight, rad
    gate_size: np.ndarray  # [G, 2] width and height of the openings, m
    bounds: np.ndarray  # [2, 3] lowest and highest corner of the box a drone may fly in, m
    frame_width: float  # of the solid border around every opening, m
    leave_distance: float  # farther than this from every gate is off the track, m
    event_time: np.ndarray  # [V] ascending, s
    event_drone: np.ndarray  # [V]
    event_kind: np.ndarray  # [V] index into `event_kind_names`
    event_gate: np.ndarray  # [V] index of the gate concerned, or -1
    event_other: np.ndarray  # [V] the other drone of a collision between drones, or -1
    event_kind_names: np.ndarray  # [K] those of `cruise.racing.events`, in this program's order
    pilots: np.ndarray  # [N] names
    track: str
    vehicle: str  # in a mixed field the names of all
    laps: int
    control_dt: float  # s between two samples
    collision_distance: float  # m
    collision_aspect: float = 1.0  # height per width of the ellipsoid in which two drones collide; 1: a sphere
    gate_roll: np.ndarray = None  # type: ignore[assignment]  # [G] about the normal, rad
    gate_pitch: np.ndarray = None  # type: ignore[assignment]  # [G] of the normal below the horizon, rad
    gate_shape: np.ndarray = None  # type: ignore[assignment]  # [G] rectangle or round
    gate_motion: np.ndarray = None  # type: ignore[assignment]  # [G, 6] sway (m), swing (rad), period (s), phase (rad)
    solid_kind: np.ndarray = None  # type: ignore[assignment]  # [S] pole, wall
    solid_shape: np.ndarray = None  # type: ignore[assignment]  # [S] cylinder or box: what it fills of the upright box around it
    solid_position: np.ndarray = None  # type: ignore[assignment]  # [S, 3] centres of those boxes, m
    solid_yaw: np.ndarray = None  # type: ignore[assignment]  # [S] heading of their first side, rad
    solid_size: np.ndarray = None  # type: ignore[assignment]  # [S, 3] length along it, width, height, m
    vehicles: np.ndarray = None  # type: ignore[assignment]  # [N] names
    finish: str = "first"  # gate of a lap at which the race ends: the first again, or the last
    version: int = FORMAT_VERSION

    def __post_init__(self) -> None:
        """Where nothing is said of tilt, shapes and solids, gates are upright rectangles and nothing else stands."""
        given = {name: getattr(self, name) for name in (*_SINCE, "gate_yaw", "pilots", "vehicle")}
        for name, value in given.items():
            if value is None:
                object.__setattr__(self, name, _SINCE[name](given))

    @property
    def num_drones(self) -> int:
        """N."""
        return self.position_w.shape[1]

    @property
    def names(self) -> tuple[str, ...]:
        """What tells drones apart: their pilots' names, in a mixed field with their vehicles."""
        return flown_in(self.pilots.tolist(), self.vehicles.tolist())

    @property
    def num_gates(self) -> int:
        """G."""
        return len(self.gate_position)

    @property
    def gates_to_finish(self) -> int:
        """Crossings that finish the race: the first one starts lap 1."""
        return gates_to_finish(self.laps, self.num_gates, self.finish)

    def save(self, path: Path | str) -> None:
        """Write a `.npz` file whole or not at all; `numpy.load(path, allow_pickle=False)` reads it."""
        write_atomically(path, self.to_bytes())

    def to_bytes(self) -> bytes:
        """The content of the `.npz` file."""
        buffer = io.BytesIO()
        arrays = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        np.savez_compressed(buffer, allow_pickle=False, **arrays)
        return buffer.getvalue()


def load_race_log(path: Path | str) -> RaceLog:
    """Read and check a race log. Raises CruiseError, naming the array at fault, where it is not a sound one."""
    where = f"race log {path}"
    arrays = _read(read_bytes(path, "race log"), where)
    version = arrays.get("version")
    if version is not None and version.shape == () and not 1 <= version <= FORMAT_VERSION:
        raise CruiseError(f"{where}: format version {version}, this program reads up to {FORMAT_VERSION}")
    if {"gate_yaw", "pilots", "vehicle"} <= arrays.keys():
        arrays = {name: np.asarray(absent(arrays)) for name, absent in _SINCE.items()} | arrays
    _check_arrays(arrays, where)
    _check_values(arrays, where)
    arrays |= _of_this_program(arrays)
    scalars = {name: arrays[name].item() for name, (_, axes) in _LAYOUT.items() if axes == ""}
    return RaceLog(**{name: scalars.get(name, arrays[name]) for name in _LAYOUT})


# Kind of dtype and axes of every array. Axes of one letter agree between arrays; a digit is a fixed length.
_LAYOUT: dict[str, tuple[str, str]] = {
    "time": ("f", "T"),
    "position_w": ("f", "TN3"),
    "velocity_w": ("f", "TN3"),
    "euler": ("f", "TN3"),
    "action": ("f", "TNA"),
    "next_gate": ("i", "TN"),
    "airborne": ("b", "TN"),
    "gate_position": ("f", "G3"),
    "gate_yaw": ("f", "G"),
    "gate_size": ("f", "G2"),
    "bounds": ("f", "23"),
    "frame_width": ("f", ""),
    "leave_distance": ("f", ""),
    "event_time": ("f", "V"),
    "event_drone": ("i", "V"),
    "event_kind": ("i", "V"),
    "event_gate": ("i", "V"),
    "event_other": ("i", "V"),
    "event_kind_names": ("U", "K"),
    "pilots": ("U", "N"),
    "track": ("U", ""),
    "vehicle": ("U", ""),
    "laps": ("i", ""),
    "control_dt": ("f", ""),
    "collision_distance": ("f", ""),
    "collision_aspect": ("f", ""),
    "gate_roll": ("f", "G"),
    "gate_pitch": ("f", "G"),
    "gate_shape": ("U", "G"),
    "gate_motion": ("f", "G6"),
    "solid_kind": ("U", "S"),
    "solid_shape": ("U", "S"),
    "solid_position": ("f", "S3"),
    "solid_yaw": ("f", "S"),
    "solid_size": ("f", "S3"),
    "vehicles": ("U", "N"),
    "finish": ("U", ""),
    "version": ("i", ""),
}
# Arrays that the first logs did not have, and what held there.
_SINCE: dict[str, Callable[[Mapping[str, np.ndarray]], np.ndarray | float | str]] = {
    "collision_aspect": lambda log: 1.0,
    "gate_roll": lambda log: np.zeros(log["gate_yaw"].shape),
    "gate_pitch": lambda log: np.zeros(log["gate_yaw"].shape),
    "gate_shape": lambda log: np.full(log["gate_yaw"].shape, "rectangle"),
    "gate_motion": lambda log: np.zeros((*log["gate_yaw"].shape, 6)),
    "solid_kind": lambda log: np.zeros(0, "U1"),
    "solid_shape": lambda log: np.zeros(0, "U1"),
    "solid_position": lambda log: np.zeros((0, 3)),
    "solid_yaw": lambda log: np.zeros(0),
    "solid_size": lambda log: np.zeros((0, 3)),
    "vehicles": lambda log: np.full(np.shape(log["pilots"]), str(log["vehicle"])),
    "finish": lambda log: "first",
}
_KINDS = {"f": "floats", "i": "integers", "b": "booleans", "U": "text"}


def _of_this_program(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Kinds of event by this program's numbers, whatever they were when the log was written."""
    kinds = np.array([EVENT_KINDS.index(name) for name in arrays["event_kind_names"].tolist()], np.int32)
    return {"event_kind": kinds[arrays["event_kind"]], "event_kind_names": np.array(EVENT_KINDS)}


# What NumPy and the standard library raise for an archive that is not one, is cut short, or holds pickles.
_BROKEN_ARCHIVE = (ValueError, OSError, EOFError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, zlib.error)


def _read(data: bytes, where: str) -> dict[str, np.ndarray]:
    if not zipfile.is_zipfile(io.BytesIO(data)):
        raise CruiseError(f"{where}: not a readable .npz file")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except _BROKEN_ARCHIVE as error:
        raise CruiseError(f"{where}: not a readable .npz file ({one_line(error)})") from None


def _check_arrays(arrays: dict[str, np.ndarray], where: str) -> None:
    """Every array present, of its kind, of shapes that agree, and finite."""
    lengths: dict[str, int] = {}
    for name, (kind, axes) in _LAYOUT.items():
        if name not in arrays:
            raise CruiseError(f"{where}: lacks array {name!r}")
        array = arrays[name]
        if array.dtype.kind != kind:
            raise CruiseError(f"{where}: array {name!r} holds {array.dtype}, expected {_KINDS[kind]}")
        expected = [int(a) if a.isdigit() else lengths.get(a) for a in axes]
        if array.ndim != len(axes) or any(e not in (None, n) for e, n in zip(expected, array.shape, strict=True)):
            shown = ", ".join(a if e is None else str(e) for a, e in zip(axes, expected, strict=True))
            raise CruiseError(f"{where}: array {name!r} has shape {list(array.shape)}, expected [{shown}]")
        lengths.update(zip(axes, array.shape, strict=True))
        if kind == "f" and not np.isfinite(array).all():
            raise CruiseError(f"{where}: array {name!r} holds numbers that are not finite")
    for axis, what in (("T", "samples"), ("N", "drones"), ("G", "gates")):
        if lengths[axis] == 0:
            raise CruiseError(f"{where}: has no {what}")


def _check_values(arrays: dict[str, np.ndarray], where: str) -> None:
    """Indices that point somewhere, times that ascend."""
    drones, gates = len(arrays["pilots"]), len(arrays["gate_yaw"])
    ranges = {
        "next_gate": (0, gates),
        "event_drone": (0, drones),
        "event_kind": (0, len(arrays["event_kind_names"])),
        "event_gate": (NOBODY, gates),
        "event_other": (NOBODY, drones),
    }
    for name, (low, high) in ranges.items():
        if ((arrays[name] < low) | (arrays[name] >= high)).any():
            raise CruiseError(f"{where}: array {name!r} holds numbers outside {low} .. {high - 1}")
    strange = [name for name in arrays["event_kind_names"].tolist() if name not in EVENT_KINDS]
    if strange:
        raise CruiseError(f"{where}: array 'event_kind_names' holds {strange[0]!r}; known are {', '.join(EVENT_KINDS)}")
    if (np.diff(arrays["time"]) <= 0).any():
        raise CruiseError(f"{where}: array 'time' does not ascend")
    times = arrays["event_time"]
    if (np.diff(times) < 0).any() or (len(times) and (times[0] < 0 or times[-1] > arrays["time"][-1] + 1e-6)):
        raise CruiseError(f"{where}: array 'event_time' does not ascend within the race")
    for name in ("laps", "control_dt", "collision_distance", "collision_aspect"):
        if arrays[name] <= 0:
            raise CruiseError(f"{where}: {name!r} must be above 0, got {arrays[name]}")
    if (arrays["gate_motion"][:, PERIOD] < 0).any():
        raise CruiseError(f"{where}: array 'gate_motion' holds a period below 0")
