"""What a race log says of its drones. Plain NumPy; every definition is in `docs/race-log.md`."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cruise.racing.events import COLLISION_KINDS
from cruise.storage.race_log import COLLISIONS, EVENT_KINDS, NOBODY, EventKind, RaceLog

NAN = float("nan")
FATES = {kind.stored: kind.fate for kind in COLLISION_KINDS}


@dataclass(frozen=True)
class DroneResult:
    """One drone in one race. Times in s, NaN where there is none."""

    finished: bool  # all laps, without a collision
    collision: str  # kind of the collision that ended its race, "" where none did
    gates_passed: int
    missed_gates: int
    finish_time: float
    last_crossing: float
    first_lap_time: float  # from standing to the end of lap 1
    flying_lap_times: tuple[float, ...]  # of laps 2, 3 ...
    mean_speed: float  # over the time in the air [m/s]
    top_speed: float  # [m/s]
    retired: bool = False  # taken out of the race, as a person's drone is whose page has gone

    @property
    def fate(self) -> str:
        """How its race ended, in two or three words."""
        return "finished" if self.finished else FATES.get(self.collision, "retired" if self.retired else "time limit")

    @property
    def flying_lap_time(self) -> float:
        """Mean of the flying laps."""
        return float(np.mean(self.flying_lap_times)) if self.flying_lap_times else NAN

    @property
    def best_lap(self) -> float:
        """Fastest lap, the standing one included."""
        laps = [lap for lap in (self.first_lap_time, *self.flying_lap_times) if not np.isnan(lap)]
        return min(laps, default=NAN)


@dataclass(frozen=True)
class RaceResult:
    """One race."""

    drones: tuple[DroneResult, ...]
    collisions: dict[str, int]  # by kind; two drones that hit each other are one collision
    overtakes: int
    ranking: tuple[int, ...]  # drones, best first
    lap_length: float  # of the closed polygon through the gates as they stood [m]

    @property
    def winner(self) -> int:
        """The drone that finished first, or -1."""
        best = self.ranking[0]
        return best if self.drones[best].finished else NOBODY


class Overtake(NamedTuple):
    """A drone that was behind another at a crossing and before it at the next."""

    time: float  # of the overtaker's crossing [s]
    drone: int
    other: int  # that was overtaken
    gate: int
    crossing: int  # its number in the race, from 0


def race_result(log: RaceLog) -> RaceResult:
    """All results of a race."""
    drones = tuple(_drone_result(log, drone) for drone in range(log.num_drones))
    return RaceResult(drones, count_collisions(log), len(overtakes(log)), _ranking(drones), lap_length(log))


def events_of(log: RaceLog, kind: EventKind, drone: int) -> np.ndarray:
    """Times of a drone's events of one kind, in order [s]."""
    return log.event_time[(log.event_kind == kind) & (log.event_drone == drone)]


def _drone_result(log: RaceLog, drone: int) -> DroneResult:
    crossings, finish = events_of(log, EventKind.CROSSING, drone), events_of(log, EventKind.FINISH, drone)
    ends = crossings[log.num_gates :: log.num_gates]  # of laps 1, 2, ...
    speed = np.linalg.norm(log.velocity_w[log.airborne[:, drone], drone].astype(np.float64), axis=1)
    return DroneResult(
        finished=len(finish) > 0,
        collision=_collision(log, drone),
        gates_passed=len(crossings),
        missed_gates=len(events_of(log, EventKind.MISSED_GATE, drone)),
        finish_time=float(finish[0]) if len(finish) else NAN,
        last_crossing=float(crossings[-1]) if len(crossings) else NAN,
        first_lap_time=float(ends[0]) if len(ends) else NAN,
        flying_lap_times=tuple(np.diff(ends).tolist()),
        mean_speed=float(speed.mean()) if len(speed) else NAN,
        top_speed=float(speed.max()) if len(speed) else NAN,
        retired=not (log.airborne[-1, drone] or len(finish) or _collision(log, drone)),
    )


def _collision(log: RaceLog, drone: int) -> str:
    """Kind of the first collision of a drone."""
    kinds = [EVENT_KINDS[kind] for kind in log.event_kind[log.event_drone == drone]]
    return next((kind for kind in kinds if kind in COLLISIONS), "")


def count_collisions(log: RaceLog) -> dict[str, int]:
    """Collisions by kind; a pair of drones counts once."""
    counts = {name: int((log.event_kind == EVENT_KINDS.index(name)).sum()) for name in COLLISIONS}
    between = log.event_kind == EventKind.COLLISION_DRONE
    pairs = np.sort(np.stack([log.event_drone[between], log.event_other[between]]), axis=0)
    return counts | {"collision_drone": len(np.unique(pairs, axis=1).T)}


def crossing_times(log: RaceLog) -> np.ndarray:
    """[N, C] time of every drone's crossing number c, NaN where it has none [s]."""
    times = np.full((log.num_drones, log.gates_to_finish), NAN)
    for drone, row in enumerate(times):
        mine = events_of(log, EventKind.CROSSING, drone)[: len(row)]
        row[: len(mine)] = mine
    return times


def overtakes(log: RaceLog) -> list[Overtake]:
    """Every overtaking of a race, in order of time."""
    times = crossing_times(log)
    found = []
    for drone, other, before in exchanges(times):
        gate = int(log.next_gate[0, 0] + before + 1) % log.num_gates
        found.append(Overtake(float(times[drone, before + 1]), drone, other, gate, before + 1))
    return sorted(found)


def exchanges(times: np.ndarray) -> list[tuple[int, int, int]]:
    """Who was behind whom in column c of `times` [N, C] and before it in the next: (drone, other, c)."""
    with np.errstate(invalid="ignore"):  # of two that started beyond a gate
        behind = times[:, None] - times[None]  # > 0 where the first drone is behind the second
    found = np.nonzero((behind[..., :-1] > 0) & (behind[..., 1:] < 0))
    return list(zip(*(column.tolist() for column in found), strict=True))


def crash_times(log: RaceLog) -> np.ndarray:
    """[N] when a collision ended each drone's race, infinite where none did [s]."""
    times = np.full(log.num_drones, np.inf)
    crashed = np.isin(log.event_kind, [EVENT_KINDS.index(name) for name in COLLISIONS])
    np.minimum.at(times, log.event_drone[crashed], log.event_time[crashed])
    return times


def _ranking(drones: tuple[DroneResult, ...]) -> tuple[int, ...]:
    """By finish; then by gates passed; then by who passed the last of them first."""

    def key(drone: int) -> tuple[float, int, float]:
        result = drones[drone]
        finish = result.finish_time if result.finished else np.inf
        return finish, -result.gates_passed, np.nan_to_num(result.last_crossing, nan=np.inf)

    return tuple(sorted(range(len(drones)), key=key))


def lap_length(log: RaceLog) -> float:
    """Length of the closed polygon through the gates [m]."""
    corners = log.gate_position
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum())
