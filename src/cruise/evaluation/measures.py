"""What protocols report of every drone of a race, from its log. Plain NumPy."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cruise.evaluation.metrics import RaceResult, crossing_times, race_result
from cruise.evaluation.statistics import Estimate, mean_estimate, rate_estimate
from cruise.racing.motion import gate_at
from cruise.storage.log_track import gates_of
from cruise.storage.race_log import RaceLog

CAUSES = {"collision_gate_frame": "gate", "collision_drone": "drone"}  # of all other collisions: the world


class Outcome(NamedTuple):
    """One race, with what its result does not have."""

    log: RaceLog
    result: RaceResult
    rank: tuple[int, ...]  # of every drone, from 1
    passed: tuple[int, ...]  # opponents that every drone overtook, as they are counted at gates

    @classmethod
    def of(cls, log: RaceLog) -> "Outcome":
        """What is measured of a race."""
        result = race_result(log)
        return cls(log, result, ranks(log, result), passed_at_gates(log))


class Measure(NamedTuple):
    """One number of a drone in a race, NaN where there is none."""

    said: str
    unit: str
    of: Callable[[Outcome, int], float]
    is_share: bool = False  # of the drones that something is true of


def _hit(cause: str) -> Callable[[Outcome, int], float]:
    def ended_by(race: Outcome, drone: int) -> float:
        mine = race.result.drones[drone]
        return float(not mine.finished and bool(mine.collision) and CAUSES.get(mine.collision, "world") == cause)

    return ended_by


def _best_lap(race: Outcome, drone: int) -> float:
    """From a crossing of the first gate to the next one; the way to it from standing is no lap."""
    crossings = crossing_times(race.log)[drone]
    laps = np.diff(crossings[np.isfinite(crossings)][:: race.log.num_gates])
    return float(laps.min()) if len(laps) else np.nan


def _speed(race: Outcome, drone: int) -> float:
    mine = race.result.drones[drone]
    return mine.mean_speed if mine.finished else np.nan


MEASURES: Mapping[str, Measure] = {
    "finished": Measure("finished", "%", lambda race, drone: race.result.drones[drone].finished, True),
    "gates": Measure(
        "share of the gates",
        "%",
        lambda r, drone: min(1.0, r.result.drones[drone].gates_passed / r.log.gates_to_finish),
    ),
    "rank": Measure("rank", "", lambda race, drone: float(race.rank[drone])),
    "hit_gate": Measure("ended at a gate", "%", _hit("gate"), True),
    "hit_world": Measure("ended at the world", "%", _hit("world"), True),
    "hit_drone": Measure("ended at a drone", "%", _hit("drone"), True),
    "best_lap": Measure("best lap", "s", _best_lap),
    "overtakes": Measure("overtakes at gates", "", lambda race, drone: float(race.passed[drone])),
    "time": Measure("time", "s", lambda race, drone: race.result.drones[drone].finish_time),
    "speed": Measure("mean speed", "m/s", _speed),
}


def ranks(log: RaceLog, result: RaceResult) -> tuple[int, ...]:
    """By finish; then by gates passed; then by the distance to the next gate where the race ended."""

    def key(drone: int) -> tuple[float, int, float]:
        mine = result.drones[drone]
        gate = gate_at(gates_of(log)[mine.gates_passed % log.num_gates], float(log.time[-1]))
        away = float(np.linalg.norm(log.position_w[-1, drone] - gate.position_w))
        return mine.finish_time if mine.finished else np.inf, -mine.gates_passed, away

    order = sorted(range(log.num_drones), key=key)
    return tuple(order.index(drone) + 1 for drone in range(log.num_drones))


def passed_at_gates(log: RaceLog) -> tuple[int, ...]:
    """Opponents that each drone was behind at a gate passage and before at the next that can be told apart.

    A passage is told apart where no two of the drones that reach it cross in the same control step or in neighbouring
    ones; only drones that reach it are compared.
    """
    times, passed = crossing_times(log), [0] * log.num_drones
    before: list[int] = []
    for passage in times.T:
        reached = np.flatnonzero(np.isfinite(passage))
        before = [drone for drone in before if drone in reached]
        steps = np.sort(np.floor(passage[reached] / log.control_dt))
        if not len(reached) or (np.diff(steps) < 2).any():
            continue
        order = [int(drone) for drone in reached[np.argsort(passage[reached])]]
        for ahead, one in enumerate(before):
            for other in before[ahead + 1 :]:
                passed[other] += order.index(other) < order.index(one)
        before = order
    return tuple(passed)


def measured(name: str, races: Sequence[Outcome], pilot: str | None = None) -> Estimate:
    """A measure over races, of all drones or of those that one pilot flew."""
    measure, per_race, drones = MEASURES[name], [], 1
    for race in races:
        mine = [d for d, flown_by in enumerate(race.log.pilots.tolist()) if pilot in (None, flown_by)]
        values = np.array([measure.of(race, drone) for drone in mine], float)
        known = values[np.isfinite(values)]
        drones = max(drones, len(mine))
        per_race.append(float(known.mean()) if len(known) else np.nan)
    return rate_estimate(per_race, drones) if measure.is_share else mean_estimate(per_race)
