"""Gates that move: where they are at a time, for whoever knows a track as `Gate`s. Plain Python and NumPy: no JAX."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from cruise.config import Gate, Motion, Track
from cruise.errors import CruiseError

FASTEST = 5.0  # that any point of an opening may move [m/s]
WIDEST = math.radians(60.0)  # that a gate may swing to either side [rad]
COLUMNS = 6  # of `motion_row`


def gate_at(gate: Gate, time: float) -> Gate:
    """A gate as it stands at a time [s], its motion left out."""
    motion = gate.motion
    if motion is None:
        return gate
    return _swayed(gate, motion, math.sin(2 * math.pi * time / motion.period + motion.phase))


def _swayed(gate: Gate, motion: Motion, share: float) -> Gate:
    x, y, z = (place + share * sway for place, sway in zip(gate.position_w, motion.sway_w, strict=True))
    return dataclasses.replace(gate, position_w=(x, y, z), yaw=gate.yaw + share * motion.swing, motion=None)


def poses(gate: Gate) -> list[Gate]:
    """A gate at rest and, where it moves, as far as it gets to either side."""
    return [gate] if gate.motion is None else [_swayed(gate, gate.motion, share) for share in (0.0, -1.0, 1.0)]


def gates_at(gates: Sequence[Gate], time: float) -> tuple[Gate, ...]:
    """All gates as they stand at a time [s]."""
    return tuple(gate_at(gate, time) for gate in gates)


def at_start(track: Track) -> Track:
    """A track as it is when races begin."""
    return dataclasses.replace(track, gates=gates_at(track.gates, 0.0)) if track.moves else track


def motion_row(motion: Motion | None) -> tuple[float, ...]:
    """Sway [3] in m, swing in rad, period in s, phase in rad; zeros for a gate that stands still."""
    if motion is None:
        return (0.0,) * COLUMNS
    return (*motion.sway_w, motion.swing, motion.period, motion.phase)


def motion_of_row(row: Sequence[float]) -> Motion | None:
    """The other way."""
    x, y, z, swing, period, phase = row
    return Motion(period, (x, y, z), swing, phase) if period else None


def reach(gate: Gate) -> float:
    """How far any point of an opening gets from where it is when its gate is at rest, at most [m]."""
    if gate.motion is None:
        return 0.0
    return math.hypot(*gate.motion.sway_w) + gate.motion.swing * gate.width / 2


def top_speed(gate: Gate) -> float:
    """Of any point of an opening, at most [m/s]."""
    return 0.0 if gate.motion is None else 2 * math.pi / gate.motion.period * reach(gate)


def moments(gates: Sequence[Gate], per_period: int = 24, most: int = 240) -> np.ndarray:
    """Times [s] at which moving gates are looked at: one period where all have the same, else several of the longest.

    Those of sine's extremes are among them where the phase is a multiple of a 24th of a turn.
    """
    periods = {gate.motion.period for gate in gates if gate.motion}
    if not periods:
        return np.zeros(0)
    shortest, longest = min(periods), max(periods)
    seconds = longest if len(periods) == 1 else 8 * longest
    return np.arange(min(most, math.ceil(per_period * seconds / shortest))) * shortest / per_period


def must_stand_still(track: Track, what: str) -> None:
    """Raises CruiseError where gates of a track move, which `what` does not know."""
    if track.moves:
        raise CruiseError(f"{what} gates that stand still, and those of {track.name!r} move")
