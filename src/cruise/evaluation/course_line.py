"""Where drones are along a course and beside it, from a race log alone. Plain NumPy."""

import functools
from typing import Any

import numpy as np

from cruise.config import Gate
from cruise.racing.ways import Way, way_between
from cruise.storage.log_track import gates_of
from cruise.storage.race_log import RaceLog

UP = np.array([0.0, 0.0, 1.0])


class CourseLine:
    """The smooth line through the middle of all gates, in the order of flight."""

    def __init__(self, gates: tuple[Gate, ...], frame_width: float) -> None:
        """One way to each gate from the one before it."""
        before = gates[-1:] + gates[:-1]
        self.legs = [way_between(a, b, frame_width) for a, b in zip(before, gates, strict=True)]
        lengths = [float(leg.steps.sum()) for leg in self.legs]
        self.length = sum(lengths)  # of a lap [m]
        self.begins = np.cumsum([0.0, *lengths[:-1]])  # of each leg [m]

    def coordinates(self, position_w: np.ndarray, next_gate: np.ndarray) -> np.ndarray:
        """[T, 3] of one drone: metres along the lap, and left and up of the line [m].

        Counted on the way to its next gate alone, so that another part of the track which passes nearby is not taken
        for its own.
        """
        found = np.zeros((len(position_w), 3))
        for gate in np.unique(next_gate).tolist():
            mine = next_gate == gate
            found[mine] = _beside(self.legs[gate], position_w[mine].astype(np.float64))
            found[mine, 0] += self.begins[gate]
        return found

    def ahead(self, along: Any, other: Any) -> Any:
        """How far the first is before the other, the shorter way round the lap: in [-L/2, L/2) [m]."""
        return (along - other + self.length / 2) % self.length - self.length / 2


def _beside(way: Way, position_w: np.ndarray) -> np.ndarray:
    """Metres along a way, left and up of it."""
    along = np.concatenate([[0.0], np.cumsum(way.steps)])
    nearest = ((position_w[:, None] - way.point_w) ** 2).sum(axis=2).argmin(axis=1)
    offset, tangent = position_w - way.point_w[nearest], way.tangent_w[nearest]
    left = np.cross(UP, tangent)
    left /= np.maximum(np.linalg.norm(left, axis=1, keepdims=True), 1e-9)
    parts = (offset * axis for axis in (left, np.cross(tangent, left)))
    ahead = (offset * tangent).sum(axis=1)  # beyond its ends, and between two samples
    return np.stack([along[nearest] + ahead, *(part.sum(axis=1) for part in parts)], axis=1)


def course_line(log: RaceLog) -> CourseLine:
    """Of the track that a race was flown on."""
    return _course_line(gates_of(log), float(log.frame_width))


@functools.lru_cache(maxsize=32)
def _course_line(gates: tuple[Gate, ...], frame_width: float) -> CourseLine:
    return CourseLine(gates, frame_width)
