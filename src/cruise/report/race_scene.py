"""What the panels of a race's picture share: the race seen as progress, and how drones are drawn."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cruise.evaluation.metrics import RaceResult, crash_times, crossing_times, race_result
from cruise.palette import DRONE_COLOURS
from cruise.palette import drone_colour as colour
from cruise.report.figure_style import Style
from cruise.storage.race_log import RaceLog

DASHES = ("-", "--", ":")  # tell drones of the same colour apart
START_WIDTH = 0.6  # of the way to the first gate, which is shorter than the others, in gates


class Scene(NamedTuple):
    """What every panel needs."""

    log: RaceLog
    result: RaceResult
    crossings: np.ndarray  # [N, C] s
    progress: np.ndarray  # [T, N] gates flown, fractions between by time


def make_scene(log: RaceLog) -> Scene:
    """What the panels need of a race."""
    crossings = crossing_times(log)
    return Scene(log, race_result(log), crossings, progress(log, crossings))


def progress(log: RaceLog, crossings: np.ndarray) -> np.ndarray:
    """[T, N] gates flown: 1 at the first crossing, linear in time between two, `START_WIDTH` before the first.

    Where a drone never came to its next gate, it moves at the pace of those that did.
    """
    starts = np.hstack([np.zeros((log.num_drones, 1)), crossings])
    paces = np.diff(starts, axis=1)
    usual = np.nanmedian(paces) if np.isfinite(paces).any() else max(float(log.time[-1]), log.control_dt)
    rows = []
    for mine in starts:
        known = mine[np.isfinite(mine)]
        number = np.arange(len(known), dtype=np.float64)
        number[0] = 1 - START_WIDTH
        beyond = np.append(known, known[-1] + 1.3 * usual), np.append(number, number[-1] + 1.0)
        rows.append(np.interp(log.time, *beyond))
    return np.stack(rows, axis=1)


def style(drone: int) -> Style:
    """Colour and dashes of a drone's lines."""
    return {"color": colour(drone), "linestyle": DASHES[drone // len(DRONE_COLOURS) % len(DASHES)]}


def flown(scene: Scene, drone: int) -> slice:
    """Samples up to the one at which a drone finished or was out."""
    return slice(0, int(scene.log.airborne[:, drone].sum()) + 1)


def crashes(log: RaceLog) -> Iterator[tuple[int, int]]:
    """Drones that collided, each with its last sample."""
    for drone in np.flatnonzero(np.isfinite(crash_times(log))).tolist():
        yield drone, min(int(log.airborne[:, drone].sum()), len(log.time) - 1)
