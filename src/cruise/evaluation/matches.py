"""Races flown for their logs, and pilots evaluated over many of them."""

import functools
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax

from cruise.config import EXACT, OUR_SIMULATOR, Firmware, InSimulator, Randomisation, Sensing, Track, Vehicle
from cruise.env.mixed import Fleet, collision_distances, each_of
from cruise.env.observation import OBSERVATIONS
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.randomise import made_for_each, perturbation
from cruise.errors import CruiseError
from cruise.evaluation.metrics import race_result
from cruise.evaluation.pilot_choice import PilotChoice, find_pilot, identity
from cruise.evaluation.race_choices import FleetChoice, RandomisationChoice, find_fleet, find_randomisation
from cruise.evaluation.summary import Evaluation, summarise
from cruise.interop.simulators import make_simulated, simulation
from cruise.pilots.base import Pilot, Versatile
from cruise.pilots.foreign import DEFAULT_BUDGET
from cruise.racing.track_geometry import lap_length
from cruise.rollout import fly_from, start_races, team_rules
from cruise.storage.policy_file import USUAL_VEHICLE, read_meta, shipped_name
from cruise.storage.race_log import RaceLog, flown_in
from cruise.storage.recorder import RaceInfo, race_logs
from cruise.vehicles import VEHICLES, find_vehicle, fly_alike, reference_to

StrPath = str | os.PathLike[str]

TIME_LIMIT = 150.0  # of a race, at least [s]
SLOWEST = 1.25  # longer races get the time that this mean speed needs [m/s]
MAX_DRONES = 64
MAX_LAPS = 100
NOTHING_RANDOM = Randomisation()
AS_MATCHED = Firmware()
DRONES_IN_BATCH = 1024  # flown at once at ten steps a second; bounds memory, not the number of races
STREAM = 0x5EED  # keeps the starts of races apart from every start seen in training, whatever the seeds


@dataclass(frozen=True)
class Match:
    """Who races whom, where, and for how long."""

    track: Track
    team: tuple[Pilot, ...]  # one pilot per drone
    laps: int
    randomisation: Randomisation = NOTHING_RANDOM
    simulator: str = OUR_SIMULATOR
    asked_for: Fleet | None = None  # what all of them fly, or each; None: what the pilots were made for
    firmware: Firmware = AS_MATCHED  # of the simulator betaflight
    sensing: Sensing = EXACT
    spread_starts: float = 0.0  # share of races that start all along the track

    @property
    def vehicle(self) -> Vehicle:
        """What all of them fly, or the first of them."""
        fleet = self.fleet
        return fleet if isinstance(fleet, Vehicle) else fleet[0]

    @property
    def fleet(self) -> Fleet:
        """What all of them fly, or each."""
        return self.asked_for or find_vehicle(self.team[0].vehicle)

    @property
    def vehicles(self) -> tuple[Vehicle, ...]:
        """What each of them flies."""
        return each_of(self.fleet, len(self.team))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the pilots, in a mixed field with their vehicles."""
        return flown_in([pilot.name for pilot in self.team], [vehicle.name for vehicle in self.vehicles])

    @property
    def collision_distance(self) -> float | tuple[float, ...]:
        """At which two drones collide, or of each drone where they differ [m]."""
        distances = collision_distances(self.vehicles)
        return distances if len(distances) > 1 else distances[0]

    def info(self, names: Sequence[str]) -> RaceInfo:
        """What a log says of its race, flown by pilots of such names."""
        distance = max(vehicle.collision_distance for vehicle in self.vehicles)
        aspect = max(vehicle.collision_aspect for vehicle in self.vehicles)
        flown = tuple(vehicle.name for vehicle in self.vehicles)
        return RaceInfo(self.track, self.laps, flown, distance, names, aspect)

    @property
    def time_limit(self) -> float:
        """When a race ends at the latest [s]."""
        longest = max(lap_length(gates) for gates in (self.track.gates, *self.track.variants))
        return max(TIME_LIMIT, self.laps * longest / SLOWEST)

    @property
    def env(self) -> RaceEnv:
        """Where it is flown."""
        simulated = self.simulator, self.firmware
        return race_env(self.track, len(self.team), self.fleet, self.randomisation, *simulated, self.sensing)


def make_match(
    track: Track,
    drones: int,
    pilots: PilotChoice | Sequence[PilotChoice] | None = None,
    laps: int | None = None,
    budget: float = DEFAULT_BUDGET,
    vehicle: FleetChoice | InSimulator | None = None,
    randomise: RandomisationChoice = 0.0,
) -> Match:
    """Put a match together.

    Args:
        track: where.
        drones: how many.
        pilots: one pilot for all drones, or one per drone; fewer than drones are repeated in turn. By default the
            policy shipped for this track, number of drones and vehicle.
        laps: by default the track's.
        budget: time for each action of a pilot in plain Python [s].
        vehicle: what all of them fly: itself, a preset's name or the path of a TOML file; or several, one per drone,
            fewer taking turns. By default what the pilots were made for; pilots of one vehicle fly another whose
            actions mean the same (`fly_alike`), if asked to. `InSimulator` says what moves it, too.
        randomise: how much of the vehicle's full randomisation (`presets.RANDOMISATION`) races differ by, 0: none; or
            each spread.

    Raises:
        CruiseError: a number out of range, more pilots than drones, no such pilot or vehicle, or pilots of different
            vehicles.
    """
    if isinstance(vehicle, InSimulator):
        match = make_match(track, drones, pilots, laps, budget, vehicle.vehicle, randomise)
        return replace(match, simulator=vehicle.simulator, firmware=vehicle.firmware)
    laps = track.laps if laps is None else laps
    _in_range("drones", drones, 1, MAX_DRONES)
    _in_range("laps", laps, 1, MAX_LAPS)
    fleet = find_fleet(vehicle, drones)
    asked = fleet[0] if fleet else None
    if pilots is None:
        pilots = shipped_name(track.name, drones, USUAL_VEHICLE if asked is None else reference_to(asked))
    choices: list[Any] = list(pilots) if isinstance(pilots, list | tuple) else [pilots]
    if not 1 <= len(choices) <= drones:
        raise CruiseError(f"{len(choices)} pilots for {drones} drones: give one for all, or at most one per drone")
    team = _team([choices[drone % len(choices)] for drone in range(drones)], fleet or (None,) * drones, budget)
    match = Match(track, team, laps, asked_for=asked if len(set(fleet)) <= 1 else fleet)
    return replace(match, randomisation=find_randomisation(randomise, match.vehicle))


def _team(choices: Sequence[Any], fleet: Sequence[Vehicle | None], budget: float) -> tuple[Pilot, ...]:
    """The pilot of every drone, put into the vehicle that it is asked to fly; the same one where both are the same."""
    found = {identity(choice): find_pilot(choice, budget) for choice in choices}
    names = {identity(choice) for choice in choices if isinstance(choice, str | os.PathLike)}
    flown = [(identity(choice), vehicle) for choice, vehicle in zip(choices, fleet, strict=True)]
    aboard = {}
    for vehicle in dict.fromkeys(fleet):
        own = {key: found[key] for key, other in flown if other == vehicle}
        aboard[vehicle] = _in_one_vehicle(own, names, vehicle)
    return tuple(aboard[vehicle][key] for key, vehicle in flown)


def _in_one_vehicle(pilots: dict[Any, Pilot], names: set[Any], asked: Vehicle | None) -> dict[Any, Pilot]:
    """The pilots, those that a name was enough for put into the vehicle that is asked for or that the others fly."""
    free = {key for key, pilot in pilots.items() if key in names and isinstance(pilot, Versatile)}
    bound = {find_vehicle(pilot.vehicle): pilot.name for key, pilot in pilots.items() if key not in free}
    if asked is None and len(bound) > 1:
        they = ", ".join(sorted(other.name for other in bound))
        raise CruiseError(f"pilots of different vehicles cannot race each other: {they}; say what all fly: vehicle")
    chosen = asked or next(iter(bound), VEHICLES[USUAL_VEHICLE])
    for other, name in bound.items():
        if not fly_alike(other, chosen):
            raise CruiseError(
                f"pilot {name!r} was made for vehicle {other.name!r}, this race flies {chosen.name!r}, whose "
                "actions mean something else"
            )
    aboard = {key: pilots[key].for_vehicle(chosen) for key in free}  # type: ignore[attr-defined]
    return pilots | aboard


def run_races(match: Match, races: int, seed: int) -> Iterator[RaceLog]:
    """Fly races from fresh random starts and give their logs, the same for the same seed.

    Raises:
        CruiseError: a number out of range, or a pilot that does not fit the race.
    """
    _in_range("number of races", races, 1, 1_000_000)
    _in_range("seed", seed, 0, 2**32 - 1)
    drones = len(match.team)
    at_once = DRONES_IN_BATCH * min(1.0, match.vehicle.control_dt / 0.1)
    batch = min(races, max(1, int(at_once) // drones))
    key = jax.random.fold_in(jax.random.key(seed), STREAM)
    for first in range(0, races, batch):
        logs = fly_batch(match, match.env, jax.random.fold_in(key, first // batch), batch)
        yield from logs[: races - first]


def fly_batch(match: Match, env: RaceEnv, key: jax.Array, batch: int) -> list[RaceLog]:
    """The logs of so many races at once in `env`."""
    team = match.team
    rules = team_rules(team, match.collision_distance, match.track.gates_to_finish(match.laps), (batch,))
    start_key, flight_key = jax.random.split(key)
    steps = round(match.time_limit / match.vehicle.control_dt)
    with simulation(match.simulator):
        state = start_races(env, start_key, (batch,), spread=match.spread_starts)
        flight = fly_from(env, team, rules, state, flight_key, steps)
    return race_logs(flight, match.info(tuple(pilot.name for pilot in team)))


def race_env(
    track: Track,
    drones: int,
    vehicle: Fleet,
    randomisation: Randomisation = NOTHING_RANDOM,
    simulator: str = OUR_SIMULATOR,
    firmware: Firmware = AS_MATCHED,
    sensing: Sensing = EXACT,
) -> RaceEnv:
    """The environment of a race; the same one for the same arguments, so that nothing is compiled twice.

    Raises:
        CruiseError: the vehicle cannot be randomised so, or not be flown in that simulator.
    """
    known = tuple(OBSERVATIONS.values())
    return _race_env(track, drones, vehicle, randomisation, simulator, firmware, sensing, known)


@functools.lru_cache(maxsize=8)
def _race_env(*choices: Any) -> RaceEnv:
    """Another one for other known observations too: those that a user added since are among what it can observe."""
    track, drones, vehicle, randomisation, simulator, firmware, sensing, _ = choices
    flown = made_for_each(vehicle, randomisation)
    if simulator == OUR_SIMULATOR:
        dynamics = None
    elif isinstance(flown, Vehicle):
        dynamics = make_simulated(simulator, flown, firmware)
    else:
        raise CruiseError(f"simulator {simulator!r} flies races of one vehicle: give one --vehicle")
    perturb = perturbation(track, flown, randomisation, sensing=sensing)
    return make_race_env(track, drones, flown, perturb=perturb, dynamics=dynamics)


def evaluate_match(match: Match, episodes: int, seed: int, show: Callable[[RaceLog], None] | None = None) -> Evaluation:
    """Fly `episodes` races, hand each to `show`, and measure them."""
    results = []
    for log in run_races(match, episodes, seed):
        if show is not None:
            show(log)
        results.append(race_result(log))
    return summarise(match.track, match.names, results, seed)


def evaluate(
    track: Track,
    drones: int,
    pilots: PilotChoice | Sequence[PilotChoice] | None = None,
    episodes: int = 100,
    seed: int = 0,
    vehicle: FleetChoice | InSimulator | None = None,
    randomise: RandomisationChoice = 0.0,
) -> Evaluation:
    """Measure pilots over races of the track's laps from standing, with true openings and final collisions.

    Args:
        track: where.
        drones: how many race each other.
        pilots: as for `make_match`.
        episodes: number of races, each from a fresh random start.
        seed: of the starts. They differ from those of training for every seed.
        vehicle: as for `make_match`.
        randomise: as for `make_match`.

    Raises:
        CruiseError: as `make_match` and `run_races`.
    """
    return evaluate_match(make_match(track, drones, pilots, vehicle=vehicle, randomise=randomise), episodes, seed)


def evaluate_policy(
    policy: StrPath, track: Track, episodes: int = 100, seed: int = 0, sensing: Sensing = EXACT
) -> dict[str, Any]:
    """What `cruise evaluate --json` prints for a policy on `track`, with as many drones as it was trained for."""
    match = replace(make_match(track, read_meta(policy).drones, Path(policy)), sensing=sensing)
    return evaluate_match(match, episodes, seed).to_dict()


def _in_range(name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        raise CruiseError(f"{name} must be from {low} to {high}, got {value}")
