"""Who is where in the order at a moment, and what has just happened, as the replay page says it."""

from typing import NamedTuple

import numpy as np

from cruise.evaluation.metrics import RaceResult, crash_times, crossing_times, overtakes, race_result
from cruise.racing.events import COLLISION_KINDS, EventKind
from cruise.racing.motion import gate_at
from cruise.storage.log_track import gates_of
from cruise.storage.race_log import RaceLog

NAN = float("nan")


class Standing(NamedTuple):
    """One drone at a moment."""

    drone: int
    passed: int  # gates
    lap: int  # 0 before the first gate
    gap: float  # how much later than the leader it passed its last gate, NaN for the leader and before the first [s]
    status: str  # "flying", "finished", or how its race ended


class Course(NamedTuple):
    """A race, prepared to be asked about moments."""

    log: RaceLog
    result: RaceResult
    crossings: np.ndarray  # [N, C] s, NaN where there is none
    ends: np.ndarray  # [N] s, when a drone crashed, inf where it did not


def make_course(log: RaceLog) -> Course:
    """Prepare a race."""
    return Course(log, race_result(log), crossing_times(log), crash_times(log))


def standings(course: Course, t: float) -> list[Standing]:
    """The drones at a time, first to last: by finish, by gates passed, by who passed the last of them first."""
    rows = [_row(course, drone, t) for drone in range(course.log.num_drones)]

    def order(row: tuple[Standing, float, float]) -> tuple[float, float, float]:
        standing, finish, last = row
        return finish, -standing.passed, last

    rows.sort(key=order)
    leader = course.crossings[rows[0][0].drone]
    return [
        standing._replace(gap=last - leader[standing.passed - 1] if place and standing.passed else NAN)
        for place, (standing, _, last) in enumerate(rows)
    ]


def _row(course: Course, drone: int, t: float) -> tuple[Standing, float, float]:
    """A standing without its gap, when the drone finished, and when it passed its last gate (or how far it is)."""
    log, result = course.log, course.result.drones[drone]
    passed = int((course.crossings[drone] <= t).sum())
    lap = min(log.laps, max(0, (passed - 1) // log.num_gates + 1))
    finished = result.finished and result.finish_time <= t
    over = min(course.ends[drone], float(log.time[-1])) <= t
    status = "finished" if finished else result.fate if over else "flying"
    last = course.crossings[drone, passed - 1] if passed else _distance_to_first_gate(log, drone, t)
    return Standing(drone, passed, lap, NAN, status), result.finish_time if finished else np.inf, float(last)


def _distance_to_first_gate(log: RaceLog, drone: int, t: float) -> float:
    """Orders the grid [m]."""
    sample = min(int(np.searchsorted(log.time, t)), len(log.time) - 1)
    gate = gate_at(gates_of(log)[log.next_gate[0, 0]], t)
    return float(np.linalg.norm(log.position_w[sample, drone] - gate.position_w))


def commentary(course: Course) -> list[tuple[float, str]]:
    """Time and one short sentence for everything worth saying, in order."""
    log = course.log
    said = [(t, f"Drone {drone + 1} overtakes drone {other + 1}") for t, drone, other, *_ in overtakes(log)]
    for time, kind, drone, other in zip(
        log.event_time.tolist(),
        log.event_kind.tolist(),
        log.event_drone.tolist(),
        log.event_other.tolist(),
        strict=True,
    ):
        if kind == EventKind.COLLISION_DRONE:
            if drone < other or other < 0:
                said.append((time, f"Drones {drone + 1} and {other + 1} collide"))
        elif kind in COLLISION_KINDS:
            said.append((time, f"Drone {drone + 1} {tuple(EventKind)[kind].said}"))
        elif kind == EventKind.FINISH:
            place = course.result.ranking.index(drone) + 1
            said.append(
                (time, f"Drone {drone + 1} wins" if place == 1 else f"Drone {drone + 1} finishes, place {place}")
            )
    return sorted(said)
