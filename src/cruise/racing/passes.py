"""How many gates one step can pass. Plain NumPy: decided once per track, so that most tracks pay for one alone."""

from collections.abc import Sequence

import numpy as np

from cruise import geometry
from cruise.config import Gate, Track
from cruise.racing.motion import reach

FASTEST = 40.0  # a drone that flies no faster can jump no gate [m/s]
PROJECTIONS = 100


def passes_per_step(track: Track, control_dt: float) -> int:
    """One more than the longest run of gates whose openings are, in all, no farther apart than a step's flight.

    So it is one wherever openings that follow each other are farther apart than `FASTEST` times the step. Those that
    move count as near each other as they might come.
    """
    every = [gate for gates in track.variants or (track.gates,) for gate in gates]
    moved = np.array([reach(gate) for gate in every]).reshape(-1, len(track.gates))
    gaps = opening_gaps(every, len(track.gates)) - moved - np.roll(moved, -1, axis=1)
    return max(_passes(of_one, FASTEST * control_dt) for of_one in gaps)


def _passes(gaps: np.ndarray, reach: float) -> int:
    count, most = len(gaps), 1
    for first in range(count):
        room, passes = reach, 1
        while passes < count and (room := room - gaps[(first + passes - 1) % count]) >= 0:
            passes += 1
        most = max(most, passes)
    return most


def opening_gaps(gates: Sequence[Gate], lap: int) -> np.ndarray:
    """Distance [V, lap] from each opening to the next, the last one of a lap back to its first [m].

    By projecting from one rectangle to the other and back (von Neumann 1933); round openings count as their squares.
    """
    centre = np.array([gate.position_w for gate in gates]).reshape(-1, lap, 3)
    sides = np.array([_sides(gate) for gate in gates]).reshape(-1, lap, 2, 3)
    other, other_sides = np.roll(centre, -1, axis=1), np.roll(sides, -1, axis=1)
    here, there = centre, other
    for _ in range(PROJECTIONS):
        here = _nearest(centre, sides, there)
        there = _nearest(other, other_sides, here)
    return np.linalg.norm(there - here, axis=-1)


def _sides(gate: Gate) -> list[tuple[float, ...]]:
    """From the centre of an opening to its left edge and to its upper one [m]."""
    heading, tilt = geometry.heading_of(gate.yaw), geometry.tilt_of(gate.roll, gate.pitch)
    half_height = (gate.width if gate.shape == "round" else gate.height) / 2
    return [geometry.from_gate(heading, edge, tilt) for edge in ((0.0, gate.width / 2, 0.0), (0.0, 0.0, half_height))]


def _nearest(centre: np.ndarray, sides: np.ndarray, point: np.ndarray) -> np.ndarray:
    """The points of rectangles that are nearest to points [... 3]."""
    lengths2 = (sides**2).sum(axis=-1)
    along = np.einsum("...k,...sk->...s", point - centre, sides) / lengths2
    return centre + np.einsum("...s,...sk->...k", np.clip(along, -1.0, 1.0), sides)
