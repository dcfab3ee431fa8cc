"""Mixed races: every pair of entrants in duels, all four in one field.

Who is better in a race: who finished, before who still flew when time was up, before who crashed. Among those who
finished the earlier one, among those still flying the one with more gates; all who crashed share the last place, for a
crash wins nothing however late it comes. A race is won by whoever is alone in first place without a crash; where
nobody is, nobody wins.
"""

import time
from collections.abc import Iterator, Sequence
from itertools import combinations

from cruise.errors import CruiseError
from cruise.evaluation.matches import make_match, run_races
from cruise.evaluation.metrics import DroneResult, race_result
from cruise.pilots.base import Pilot
from cruise.racing.track_file import load_track
from cruise.storage.race_log import RaceLog
from experiments.measure import FRESH, load_as
from experiments.plan import DUEL, ENTRANTS, KINDS, Job
from experiments.results import FORMAT, HeadToHead, Meeting
from experiments.work import Step, Work

LEAST_PER_ORDER = 10
TIE = 1e-6  # finish times nearer than this are equal [s]


def make_head_to_head(work: Work, job: Job) -> Iterator[Step]:
    """Fly all line-ups of a track and a number of drones, and write the result."""
    started = time.monotonic()
    pilots = {kind: _entrant(work, kind, job) for kind in ENTRANTS}
    fields = list(combinations(ENTRANTS, DUEL)) if job.drones == DUEL else [ENTRANTS]
    meetings = []
    for number, entrants in enumerate(fields):
        yield Step("racing", number, len(fields))
        logs = _fly(job, [pilots[kind] for kind in entrants], work.scale.races)
        meetings.append(meeting_of(entrants, logs))
        if entrants == ENTRANTS and job.seed == work.scale.seeds[0]:
            logs[0].save(work.results.race_of(job))
    origin, policies = work.origin(job, started), checksums(work, job)
    work.results.write(job, HeadToHead(FORMAT, job.track, job.drones, job.seed, origin, policies, tuple(meetings)))


def checksums(work: Work, job: Job) -> dict[str, str]:
    """Of the policies that meet in a job."""
    learned = [kind for kind in ENTRANTS if KINDS[kind].family == "learned"]
    return {kind: work.results.checksum_of(Job(kind, job.track, job.drones, job.seed)) for kind in learned}


def _entrant(work: Work, kind: str, job: Job) -> str | Pilot:
    """A kind's pilot, or the name of a planner."""
    if KINDS[kind].family == "planner":
        return kind
    wanted = Job(kind, job.track, job.drones, job.seed)
    path = work.results.policy_of(wanted)
    if not path.with_name(f"{path.name}.json").exists():
        raise CruiseError(f"needs the policy of {wanted.name}")
    return load_as(path, kind)


def _fly(job: Job, field: Sequence[str | Pilot], races: int) -> list[RaceLog]:
    """Races in which every entrant flies as every drone, equally often, give or take one.

    Lanes are drawn anew for each race and no drone is special: taking turns makes sure of it. Every order compiles
    anew, so there are as many as give `LEAST_PER_ORDER` races each.
    """
    track = load_track(job.track)
    orders = max(1, min(len(field), races // LEAST_PER_ORDER))
    logs: list[RaceLog] = []
    for shift in range(orders):
        team = [field[(drone + shift) % len(field)] for drone in range(len(field))]
        share = races // orders + (shift < races % orders)
        logs += run_races(make_match(track, len(team), team), share, FRESH + job.seed)
    return logs


def meeting_of(entrants: tuple[str, ...], logs: Sequence[RaceLog]) -> Meeting:
    """What is kept of races between entrants, whatever drones they flew as."""
    rank, finish, crashed = [], [], []
    for log in logs:
        by_name = dict(zip(log.pilots.tolist(), race_result(log).drones, strict=True))
        drones = [by_name[name] for name in entrants]
        rank.append(places(drones))
        finish.append(tuple(round(drone.finish_time, 4) if drone.finished else None for drone in drones))
        crashed.append(tuple(bool(drone.collision) for drone in drones))
    return Meeting(entrants, tuple(rank), tuple(finish), tuple(crashed))


def places(drones: Sequence[DroneResult]) -> tuple[int, ...]:
    """Place of every drone from 1, equal for a tie: one more than how many were better."""
    return tuple(1 + sum(_beats(other, drone) for other in drones) for drone in drones)


def _beats(one: DroneResult, other: DroneResult) -> bool:
    classes = _class(one), _class(other)
    if classes[0] != classes[1]:
        return classes[0] < classes[1]
    if one.finished:
        return one.finish_time < other.finish_time - TIE
    return not one.collision and one.gates_passed > other.gates_passed


def _class(drone: DroneResult) -> int:
    """0 finished, 1 still flying, 2 crashed."""
    return 0 if drone.finished else 2 if drone.collision else 1


def winner(rank: Sequence[int], crashed: Sequence[bool]) -> int | None:
    """Who won a race; None where nobody did."""
    first = [entrant for entrant, place in enumerate(rank) if place == 1]
    return first[0] if len(first) == 1 and not crashed[first[0]] else None
