"""Where drones can wait for the start: within the track, off its solids. Plain NumPy: decided once per race."""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cruise.config import Gate, StartLine, StartPlaces, Track, Vec3
from cruise.errors import CruiseError
from cruise.racing.clearance import clearance
from cruise.racing.motion import at_start
from cruise.racing.solids import outlines

LANE_SPACING = 1.25  # [m]
ROW_SPACING = 1.5  # [m]
JITTER = 0.08  # of every coordinate; even along a diagonal 1.25 - 2 * 0.08 * sqrt(2) > 1.02 m remain between two [m]
NEAREST, FARTHEST = 1.5, 3.0  # of the first row from the gate [m]
MIN_HEIGHT = 0.3  # [m]
CLEAR = 0.3  # of solids [m]
USUAL_FIELD = 4  # drones for whom `cruise tracks check` wants room


class Grid(NamedTuple):
    """Rows of drones behind a gate."""

    lanes: int = 4  # drones in a row
    scale: float = 1.0  # of all spacings
    farthest: float = FARTHEST  # the first row stands so far from the gate at most [m]


USUAL = Grid()
# Tried in turn where the usual one does not fit. The closest leaves 0.6 * 1.25 - 2 * 0.08 * sqrt(2) > 0.5 m.
GRIDS = tuple(
    Grid(lanes, scale, farthest)
    for scale, farthest, lanes in itertools.product((1.0, 0.8, 0.6), (FARTHEST, NEAREST), (4, 3, 2, 1, 5, 6, 8, 12))
)


FILE = Grid(lanes=1)  # one behind the other


class StartPlan(NamedTuple):
    """How the drones of a race wait: at `places`, or on a grid before one of some gates."""

    gates: tuple[int, ...]  # that may be the first
    grids: tuple[Grid, ...]  # by gate of the track; those of gates that have no room are never used
    places: tuple[tuple[Vec3, float], ...] = ()  # position and yaw, at least one per drone


def start_plan(track: Track, drones: int) -> StartPlan | None:
    """Where so many drones start; None where the usual grid fits before every gate.

    Raises:
        CruiseError: the track has no room for so many.
    """
    if track.start is not None:
        places = start_places(track, drones)
        if len(places) < drones:
            raise CruiseError(f"{track.name} has places for {len(places)} drones to start from, not for {drones}")
        _refuse_outside(track, places)
        return StartPlan((track.start_gate,), (USUAL,) * len(track.gates), tuple(places))
    grids = grids_that_fit(track, drones)
    open_gates = tuple(g for g, grid in enumerate(grids) if grid is not None)
    if not open_gates:
        raise CruiseError(f"{track.name} has no gate with room for {drones} drones to start: race fewer")
    if all(grid == USUAL for grid in grids):
        return None
    return StartPlan(open_gates, tuple(grid or USUAL for grid in grids))


def spread_plan(track: Track, drones: int) -> StartPlan | None:
    """Before which gates drones can start in single file, as few behind each other as there is room for.

    None, which stands for all gates, where there is no room for so many.
    """
    anywhere = dataclasses.replace(track, start=None)
    for rows in range(1, drones + 1):
        fits = [grid is not None for grid in grids_that_fit(anywhere, rows, (FILE,))]
        if rows * sum(fits) >= drones:
            gates = tuple(g for g, fit in enumerate(fits) if fit)
            return StartPlan(gates, (FILE,) * len(track.gates))
    return None


def start_places(track: Track, drones: int) -> list[tuple[Vec3, float]]:
    """The places that the track says, for a line as many as there are drones."""
    start = track.start
    if start is None:
        return []
    if isinstance(start, StartPlaces):
        return [(place.position_w, place.yaw) for place in start.places]
    (x, y, z), left = start.middle_w, (-math.sin(start.yaw), math.cos(start.yaw))
    sideways = [(i - (drones - 1) / 2) * start.spacing for i in range(drones)]
    return [((x + left[0] * s, y + left[1] * s, z), start.yaw) for s in sideways]


def _refuse_outside(track: Track, places: Sequence[tuple[Vec3, float]]) -> None:
    if not _is_free(track, at_start(track).gates, np.array([place for place, _ in places])).all():
        raise CruiseError(f"{track.name} has no room for {len(places)} drones on its start line: race fewer")


def start_faults(track: Track) -> Iterator[str]:
    """What is wrong with a track's start, or that no gate has room for one."""
    if track.start is None:
        if not any(grids_that_fit(track, 1)):
            yield "no gate has room for a start: 1.6 m before it must lie within the bounds and off all solids"
        return
    places = start_places(track, 1)
    free = _is_free(track, at_start(track).gates, np.array([place for place, _ in places]))
    for number, ((x, y, z), _) in enumerate(places, start=1):
        name = "middle" if isinstance(track.start, StartLine) else f"place {number}"
        if not free[number - 1] or z <= 0:
            yield f"start: {name} at ({x:g}, {y:g}, {z:g}) lies outside the track, under ground or in a solid"


def start_warnings(track: Track) -> Iterator[str]:
    """Gates that no race of a usual field can start before."""
    if track.start is None:
        for g, grid in enumerate(grids_that_fit(track, USUAL_FIELD)):
            if grid is None:
                yield f"gate {g + 1}: has no room for a start grid of {USUAL_FIELD} drones: no race starts there"


def grids_that_fit(track: Track, drones: int, grids: Sequence[Grid] = GRIDS) -> list[Grid | None]:
    """For every gate the first of `grids` that fits, None where none does.

    With variants one grid that fits before every gate of all of them.
    """
    if track.variants:
        tracks = [
            dataclasses.replace(track, obstacles=solids) for solids in track.variant_obstacles or [track.obstacles]
        ]
        every_gate = [
            (one, v, gate) for one, v in zip(itertools.cycle(tracks), track.variants, strict=False) for gate in v
        ]
        every = (grid for grid in grids if all(_fits(one, v, gate, grid, drones) for one, v, gate in every_gate))
        return [next(every, None)] * len(track.gates)
    track = at_start(track)
    return [
        next((grid for grid in grids if _fits(track, track.gates, gate, grid, drones)), None) for gate in track.gates
    ]


def _fits(track: Track, gates: Sequence[Gate], gate: Gate, grid: Grid, drones: int) -> bool:
    slot = np.arange(drones)
    row, lane = slot // grid.lanes, slot % grid.lanes
    sideways = (lane - (np.minimum(drones - row * grid.lanes, grid.lanes) - 1) / 2) * LANE_SPACING * grid.scale
    cos, sin = math.cos(gate.yaw), math.sin(gate.yaw)
    x0, y0, z0 = gate.position_w
    for first in np.linspace(NEAREST, grid.farthest, 8 if track.obstacles else 2):
        back = first + row * ROW_SPACING * grid.scale
        points = np.stack([x0 - cos * back - sin * sideways, y0 - sin * back + cos * sideways, 0 * back + z0], axis=1)
        points[:, 2] = np.maximum(points[:, 2], MIN_HEIGHT)
        if not _is_free(track, gates, points).all():
            return False
    return True


def _is_free(track: Track, gates: Sequence[Gate], points: np.ndarray) -> np.ndarray:
    """Which points [P, 3], wherever the jitter puts them, lie within the track and off its solids."""
    low, high = np.array([*track.bounds_low[:2], -np.inf]) + JITTER, np.array(track.bounds_high) - JITTER
    free = ((points >= low) & (points <= high)).all(axis=1)
    centre = np.array([gate.position_w for gate in gates])
    nearest2 = ((points[:, None] - centre) ** 2).sum(axis=-1).min(axis=1)
    free &= nearest2 <= max(track.leave_distance - 2 * JITTER, 0.0) ** 2
    for solid in outlines(track.obstacles):
        free &= clearance(solid, tuple(points.T)).distance >= CLEAR
    return np.asarray(free)
