"""Flies a pilot through the scenarios of racecraft and measures what it makes of them, from race logs alone."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import Track
from cruise.env.observation import for_any_field
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.errors import CruiseError
from cruise.evaluation.blame import Contact, contacts
from cruise.evaluation.matches import STREAM, Match, make_match
from cruise.evaluation.metrics import crossing_times, exchanges, race_result
from cruise.evaluation.pilot_choice import PilotChoice, pilot_meta
from cruise.evaluation.scenarios import MOST_DRONES, NEXT, SCENARIOS, Place, Scenario
from cruise.evaluation.statistics import Estimate, count_estimate, mean_estimate, rate_estimate
from cruise.pilots.base import Pilot
from cruise.pilots.foreign import DEFAULT_BUDGET
from cruise.pilots.rival import Rival
from cruise.racing.course import course_at
from cruise.racing.grid import before_gates
from cruise.racing.start_room import JITTER, Grid, grids_that_fit
from cruise.rollout import Flight, fly_from, team_rules
from cruise.storage.race_log import RaceLog
from cruise.storage.recorder import RaceInfo, race_logs
from cruise.vehicles import VehicleChoice

PILOT = 0  # its drone in every scenario
LAPS = 2  # enough for a drone that is half as fast to be caught
PATIENCE = 2.0  # a run may take so many times as long as the pilot needs alone
TWO_BY_TWO = Grid(lanes=2)  # the room that the scenarios take before a gate


class Run(NamedTuple):
    """One run of a scenario, as its log tells it."""

    log: RaceLog
    finished: bool
    first: bool  # nobody passed the pilot's last gate before it
    passes: int  # opponents that it overtook, from gate to gate
    places_lost: int
    time_lost: float  # against the same start alone [s]; NaN where it did not finish both
    contacts: tuple[Contact, ...]  # of the pilot

    @property
    def fault(self) -> float:
        """The pilot's part in its contacts."""
        return sum(contact.fault_of(PILOT) for contact in self.contacts)


@dataclass(frozen=True)
class Outcome:
    """All runs of a scenario."""

    scenario: Scenario
    runs: tuple[Run, ...]

    @property
    def measured(self) -> dict[str, Estimate]:
        """Every quantity over the runs."""
        runs, wanted = self.runs, self.scenario.first
        good = [r.finished and r.fault == 0 and (r.first or not wanted) for r in runs]
        return {
            "good": rate_estimate([float(g) for g in good], 1),
            "finished": rate_estimate([float(r.finished) for r in runs], 1),
            "first": rate_estimate([float(r.first) for r in runs], 1),
            "passes": count_estimate([r.passes for r in runs]),
            "places_lost": count_estimate([r.places_lost for r in runs]),
            "time_lost": mean_estimate([r.time_lost for r in runs]),
            "contacts": count_estimate([len(r.contacts) for r in runs]),
            "fault": count_estimate([r.fault for r in runs]),
        }

    def to_dict(self) -> dict[str, Any]:
        """The object that `cruise racecraft --json` prints."""
        rules: dict[str, int] = {}
        for contact in (contact for run in self.runs for contact in run.contacts):
            rules[contact.rule] = rules.get(contact.rule, 0) + 1
        told = {"scenario": self.scenario.name, "runs": len(self.runs), "contacts_by_rule": rules}
        return told | {name: estimate.to_dict() for name, estimate in self.measured.items()}


def measure_racecraft(
    track: Track,
    pilot: PilotChoice | None = None,
    runs: int = 40,
    seed: int = 0,
    vehicle: VehicleChoice | None = None,
    budget: float = DEFAULT_BUDGET,
) -> list[Outcome]:
    """Fly every scenario that the pilot can fly `runs` times, before every gate with room in turn.

    Raises:
        CruiseError: a number out of range, no such pilot, or one that flies alone; a track without room.
    """
    if not 1 <= runs <= 10_000:
        raise CruiseError(f"runs must be from 1 to 10000, got {runs}")
    match = make_match(track, _field(pilot), pilot, LAPS, budget, vehicle)
    scenarios = [scenario for scenario in SCENARIOS if scenario.drones <= len(match.team)]
    stage = _Stage(match, scenarios, runs, jax.random.fold_in(jax.random.key(seed), STREAM))
    alone = stage.fly(lambda _: 0, pace=1.0, seconds=match.time_limit)
    solo = [race_logs(_cut(alone, 1, [row]), stage.info(1))[0] for row in range(stage.batch)]
    pace, seconds = _pace(solo), PATIENCE * max(float(log.time[-1]) for log in solo)
    flown = {
        itself: stage.fly(lambda s, i=itself: s.drones - 1 if s.against_itself == i else 0, pace, seconds, itself)
        for itself in {scenario.against_itself for scenario in scenarios}
    }
    outcomes = []
    for number, scenario in enumerate(scenarios):
        rows = list(range(number * runs, (number + 1) * runs))
        cut = _cut(flown[scenario.against_itself], scenario.drones, rows)
        logs = race_logs(cut, stage.info(scenario.drones, scenario.against_itself))
        measured = (run_of(log, solo[row]) for log, row in zip(logs, rows, strict=True))
        outcomes.append(Outcome(scenario, tuple(measured)))
    return outcomes


def _field(choice: PilotChoice | None) -> int:
    """How many drones the environment has: as many as the largest scenario, or as the policy was made for."""
    meta = None if choice is None else pilot_meta(choice)
    if meta is None or for_any_field(meta.observation):
        return MOST_DRONES
    if meta.drones < 2:
        raise CruiseError(f"policy {meta.name!r} was made for races of one drone: racecraft needs opponents")
    return meta.drones


def run_of(log: RaceLog, alone: RaceLog) -> Run:
    """What a log tells of the pilot; `alone` is the same start without anybody else."""
    times, gates = _times_by_gate(log), log.gates_to_finish
    mine = exchanges(times)
    result, solo = race_result(log).drones[PILOT], race_result(alone).drones[PILOT]
    last = times[:, max(result.gates_passed, 1) - 1]
    touched = tuple(contact for contact in contacts(log) if PILOT in contact.drones)
    return Run(
        log=log,
        finished=result.finished,
        first=result.gates_passed == gates and not (np.delete(last, PILOT) < last[PILOT]).any(),
        passes=sum(drone == PILOT for drone, _, _ in mine),
        places_lost=sum(other == PILOT for _, other, _ in mine),
        time_lost=result.finish_time - solo.finish_time,
        contacts=touched,
    )


def _times_by_gate(log: RaceLog) -> np.ndarray:
    """[N, C] when each drone passed the gate of the pilot's crossing number c [s].

    NaN where it never did, minus infinity where it started beyond that gate.
    """
    start = (log.next_gate[0] - log.next_gate[0, PILOT]) % log.num_gates
    crossings = crossing_times(log)
    shifted = np.full_like(crossings, -np.inf)
    for row, times, ahead in zip(shifted, crossings, start.tolist(), strict=True):
        row[ahead:] = times[: len(row) - ahead]
    return shifted


def _pace(solo: Sequence[RaceLog]) -> float:
    """The pilot's mean speed alone, over the runs that it finished, or over all [m/s]."""
    results = [race_result(log).drones[PILOT] for log in solo]
    done = [result.mean_speed for result in results if result.finished]
    return float(np.mean(done or [result.mean_speed for result in results]))


class _Stage:
    """All runs of all scenarios as one batch, so that they are compiled once."""

    def __init__(self, match: Match, scenarios: Sequence[Scenario], runs: int, key: jax.Array) -> None:
        self.match, self.scenarios, self.key = match, scenarios, key
        self.env: RaceEnv = match.env
        self.runs, self.batch = runs, runs * len(scenarios)
        self.drones = len(match.team)
        self.first_gate = np.tile(_first_gates(match.track, runs), len(scenarios))
        self.state = self._start()

    def info(self, drones: int, itself: bool = False) -> RaceInfo:
        """What logs of so many drones say beside the flight."""
        vehicle, name = self.match.vehicle, self.match.team[0].name
        names = [name, *["rival"] * (drones - 1)] if not itself else [name] * drones
        distance, aspect = vehicle.collision_distance, vehicle.collision_aspect
        return RaceInfo(self.match.track, LAPS, (vehicle.name,), distance, names, aspect)

    def fly(self, opponents: Any, pace: float, seconds: float, itself: bool = False) -> Flight:
        """Fly all runs, with as many opponents as `opponents(scenario)` says; the pilot's own or rivals."""
        present = np.repeat([1 + opponents(scenario) for scenario in self.scenarios], self.runs)
        out = jnp.arange(self.drones)[:, None] >= jnp.asarray(present)
        pilot, rival = self.match.team[0], self._rival(pace)
        own = 2 if itself else 1
        team: list[Pilot] = [pilot] * own + [rival] * (self.drones - own)
        vehicle, track = self.match.vehicle, self.match.track
        rules = team_rules(team, vehicle.collision_distance, track.gates_to_finish(LAPS), (self.batch,))
        steps = round(seconds / vehicle.control_dt)
        return fly_from(self.env, team, rules, self.state._replace(out=out), self.key, steps)

    def _start(self) -> RaceState:
        """Everybody at rest at the place of its scenario, a little off it by chance."""
        course, gates = course_at(self.env.course, 0.0), len(self.match.track.gates)
        places = self._by_drone(lambda s: [s.place, *(o.place for o in s.opponents)], Place(0, 2.0))
        ahead, back, left = (jnp.asarray(part) for part in np.moveaxis(places, 2, 0))
        first = (jnp.asarray(self.first_gate) + ahead.astype(jnp.int32)) % gates
        jitter = jax.random.uniform(self.key, (3, self.drones, self.batch), minval=-JITTER, maxval=JITTER)
        return self.env.begin(before_gates(course, first, back, left, jitter))

    def _rival(self, pace: float) -> Rival:
        """The rivals of all scenarios, each as its own says."""
        vehicle = self.match.vehicle
        half = min(gate.width for gate in self.match.track.gates) / 2
        told = self._by_drone(lambda s: [(0, 0, 0), *((o.pace, o.lane, o.falls_after) for o in s.opponents)], (0, 0, 0))
        share, lane, falls_after = (jnp.asarray(part) for part in np.moveaxis(told, 2, 0))
        slowest = 0.1 * pace  # where nobody flies
        tracking = vehicle.tracking
        return Rival(
            speed=jnp.maximum(share * pace, slowest),
            lane=lane * half,
            falls_after=falls_after,
            agility=vehicle.agility,
            vehicle=self.match.team[0].vehicle,
            velocity_gain=tracking.velocity_gain,
        )

    def _by_drone(self, of: Any, absent: Sequence[float]) -> np.ndarray:
        """[N, E, K] numbers of every drone of every run."""
        rows = [list(of(scenario)) + [absent] * (self.drones - scenario.drones) for scenario in self.scenarios]
        return np.repeat(np.array(rows, np.float32).swapaxes(0, 1), self.runs, axis=1)


def _first_gates(track: Track, runs: int) -> np.ndarray:
    """The pilot's first gate of every run: in turn those that have room, the gate after them too."""
    if track.variants:
        raise CruiseError(f"track {track.name!r} is another one in every race: name one track")
    fits = grids_that_fit(dataclasses.replace(track, start=None), 4, (TWO_BY_TWO,))
    gates = [g for g in range(len(fits)) if fits[g] and fits[(g + NEXT) % len(fits)]]
    if not gates:
        raise CruiseError(f"track {track.name!r} has no two gates in a row with room for two rows of two drones")
    return np.resize(gates, runs)


def _cut(flight: Flight, drones: int, rows: list[int]) -> Flight:
    """The first drones of some races, up to the end of the last of them."""
    cut = jax.tree.map(lambda x: x[..., :drones, rows] if np.ndim(x) > 1 else x, flight)
    return cut
