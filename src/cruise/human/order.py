"""Who is where in a race that is being flown: the order, laps and gaps, step by step."""

import itertools
from typing import Any, NamedTuple

import numpy as np

from cruise.env.types import Collisions
from cruise.racing.events import COLLISION_KINDS
from cruise.racing.gates import Crossing

FLYING, FINISHED, RETIRED = "flying", "finished", "retired"


class Happened(NamedTuple):
    """A step of one race, NumPy arrays [N]."""

    crossing: Crossing
    further: tuple[Crossing, ...]
    collisions: Collisions


class Order:
    """Crossings so far, and what has become of every drone."""

    def __init__(self, drones: int, gates: int, laps: int) -> None:
        self.gates, self.laps = gates, laps
        self.crossings: list[list[float]] = [[] for _ in range(drones)]  # [s]
        self.status = [FLYING] * drones

    def take(self, time: float, dt: float, step: Happened, finished: np.ndarray) -> bool:
        """Take a step that began at `time` [s], of one race; whether anything changed.

        Args:
            time: of its beginning [s].
            dt: its duration [s].
            step: what happened in it.
            finished: [N] by now.
        """
        before = (sum(map(len, self.crossings)), tuple(self.status))
        for crossing in (step.crossing, *step.further):
            for drone in np.flatnonzero(np.asarray(crossing.passed)):
                self.crossings[drone].append(time + dt * float(crossing.fraction[drone]))
        for drone in np.flatnonzero(finished):
            self.status[drone] = FINISHED
        for kind in COLLISION_KINDS:
            for drone in np.flatnonzero(getattr(step.collisions, kind.hit)):
                if self.status[drone] == FLYING:
                    self.status[drone] = kind.fate
        return before != (sum(map(len, self.crossings)), tuple(self.status))

    def retire(self, drone: int) -> None:
        """A drone is taken out of the race."""
        if self.status[drone] == FLYING:
            self.status[drone] = RETIRED

    def rows(self) -> list[dict[str, Any]]:
        """A row for each drone, first to last; gaps to the leader in s, None where there is none."""

        def place(drone: int) -> tuple[float, int, float]:
            times = self.crossings[drone]
            finish = times[-1] if self.status[drone] == FINISHED else np.inf
            return finish, -len(times), times[-1] if times else np.inf

        order = sorted(range(len(self.crossings)), key=place)
        leader = self.crossings[order[0]]
        return [self._row(drone, leader, first=drone == order[0]) for drone in order]

    def _row(self, drone: int, leader: list[float], first: bool) -> dict[str, Any]:
        times = self.crossings[drone]
        gap = None if first or not times else round(times[-1] - leader[len(times) - 1], 3)
        starts = times[:: self.gates]
        return {
            "drone": drone,
            "status": self.status[drone],
            "passed": len(times),
            "lap": min(self.laps, max(0, (len(times) - 1) // self.gates + 1)),
            "gap": gap,
            "last": round(times[-1], 3) if times else None,
            "began": round(starts[-1], 3) if starts else None,  # the present lap
            "laps": [round(b - a, 3) for a, b in itertools.pairwise(starts)],
        }
