"""What a race through an adapter is, as its user says it, and what follows from it. Nothing here starts JAX."""

import dataclasses
import difflib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from cruise.actions import Action
from cruise.config import ObservationKind, Randomisation, RewardWeights, Sensing, Stage, Track, TrainConfig, Vehicle
from cruise.env.mixed import collision_distances, field_dynamics, groups_of
from cruise.env.observation import observation_layout
from cruise.env.payment import find_reward_terms
from cruise.env.randomise import made_for
from cruise.errors import CruiseError
from cruise.evaluation.matches import MAX_DRONES, MAX_LAPS, Match
from cruise.evaluation.pilot_choice import PilotChoice, pilot_meta
from cruise.evaluation.race_choices import (
    FleetChoice,
    RandomisationChoice,
    SensingChoice,
    TrackChoice,
    find_fleet,
    find_randomisation,
    find_sensing,
    find_spread,
    find_track,
)
from cruise.pilots.terms_file import load_all_terms
from cruise.presets import CURRICULUM, REWARDS, curriculum_of, training_config
from cruise.storage.policy_file import shipped_name
from cruise.terms import Entry, RewardTerm, Setting
from cruise.vehicles import find_vehicle, fly_alike, reference_to

RACE = "race"
ALSO_CALLED = {"max_episode_steps": "episode_steps", "max_cycles": "episode_steps"}  # by Gymnasium and PettingZoo


class UnknownOption(CruiseError, TypeError):
    """An option that a race does not have, in the words of Python for an argument that a function does not have."""


@dataclass(frozen=True)
class RaceOptions:
    """What is raced, by whom, and under which rules."""

    track: TrackChoice = "ring"
    """A track, the name of a built-in one, or the path of a TOML file."""
    drones: int | None = None
    """In a race. By default one more than opponents are named, one per vehicle, or 2; where all learn 4."""
    opponents: PilotChoice | Sequence[PilotChoice] | None = None
    """Who flies against the learner, as `cruise.race` takes pilots: one for all, or one each; fewer take turns. By
    default the policy shipped for this track and number of drones."""
    stage: int | Literal["race"] = len(CURRICULUM)
    """Rules and reward of a stage of the curriculum, 1 to 5, or of a real race: true openings, every collision final,
    a finish, and the race of a seed that of `cruise.race` with this seed."""
    laps: int | None = None
    """Of a real race; by default the track's."""
    observation: ObservationKind | None = None
    """What the learner sees. It speaks in the same frame: with `extended` in that of its target gate. By default what
    policies of the vehicle are trained with, as `training_config` says: `extended`, with rotors `body`."""
    reward: RewardWeights | str | None = None
    """Weights, or the name of a preset. By default those that policies of the vehicle are trained with: `default`, with
    rotors `agile`."""
    terms: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = ()
    """Python files that declare observations and reward terms of your own; their code is run, and all reward terms are
    added."""
    vehicle: FleetChoice = "paper"
    """What all fly: a vehicle, the name of a built-in one, or the path of a TOML file; or several, one per drone, fewer
    taking turns."""
    agility: float | None = None
    """Scale of the learner's action [m/s^2]. By default the stage's in the vehicle's curriculum."""
    episode_steps: int | None = None
    """Time limit in control steps, at which an episode is truncated. By default that of training episodes, or a race's
    usual limit. `max_episode_steps` and `max_cycles` are other names of it."""
    randomise: RandomisationChoice | None = None
    """How far races differ from what vehicle and track say, as a share of all that the vehicle may differ by, or each
    spread. By default as policies of the vehicle are trained; in a real race 0."""
    sensing: SensingChoice | None = None
    """What drones know of gates, opponents and themselves: `exact`, `range`, `camera`, or a `cruise.Sensing`. By
    default as policies of the vehicle are trained: `exact`."""
    spread_starts: float | None = None
    """Share of races that start all along a track which has a start of its own. By default as policies of the vehicle
    are trained; in a real race 0."""

    def changed(self, changes: dict[str, Any]) -> "RaceOptions":
        """With some options changed.

        Raises:
            UnknownOption: there is no such option.
        """
        known = [field.name for field in dataclasses.fields(self)]
        given = {ALSO_CALLED.get(name, name): value for name, value in changes.items()}
        for name in given:
            if name not in known:
                close = difflib.get_close_matches(name, known, n=1)
                hint = f"did you mean {close[0]!r}? " if close else ""
                raise UnknownOption(
                    f"unexpected keyword argument {name!r} of a race: {hint}options: {', '.join(known)}"
                )
        if len(given) < len(changes):
            raise UnknownOption(f"episode_steps has two names here: {', '.join(changes)}; give one")
        return dataclasses.replace(self, **given)


class Choices(NamedTuple):
    """What follows from the options: static, and known before JAX starts."""

    track: Track
    fleet: tuple[Vehicle, ...]  # of every drone
    learners: tuple[int, ...]  # drones that are flown from outside
    opponents: tuple[PilotChoice, ...]  # of the other drones, taking turns
    stage: Stage
    agility: tuple[float, ...]  # scale of each learner's actions
    gates_to_finish: int  # 0: no finish
    collision_distance: tuple[float, ...]  # of all drones, or of each [m]
    observation: ObservationKind
    weights: RewardWeights
    more_terms: tuple[RewardTerm, ...]  # of the reward
    randomisation: Randomisation
    sensing: Sensing
    spread: float  # share of starts all along the track
    limit: int  # of an episode, in control steps
    drones: int
    layout: tuple[Entry, ...]  # what the numbers of the observation are
    action: Action  # what the numbers of an action are, the widest where vehicles differ

    @property
    def vehicle(self) -> Vehicle:
        """The first learner's."""
        return self.fleet[0]


def choose(options: RaceOptions, everybody_learns: bool) -> Choices:
    """What follows from the options.

    Raises:
        CruiseError: something does not exist, is out of range, or does not go together.
    """
    files = (options.terms,) if isinstance(options.terms, str | os.PathLike) else options.terms
    more = find_reward_terms(load_all_terms(files))
    track, drones, race = find_track(options.track), _drones(options, everybody_learns), options.stage == RACE
    fleet = find_fleet(options.vehicle, drones)
    vehicle, laps = fleet[0], _laps(options, track)
    usual = training_config(vehicle, drones)
    learners = tuple(range(drones)) if everybody_learns else (0,)
    randomisation = _randomisation(options, usual, vehicle)
    dynamics = field_dynamics(groups_of([made_for(one, randomisation) for one in fleet]))
    observation = usual.observation if options.observation is None else options.observation
    spread = options.spread_starts if options.spread_starts is not None else 0.0 if race else usual.spread_starts
    return Choices(
        track=track,
        fleet=fleet,
        learners=learners,
        opponents=_opponents(options, track, fleet) if len(learners) < drones else (),
        stage=_stage(options, vehicle),
        agility=tuple(_agility(options, fleet[drone]) for drone in learners),
        gates_to_finish=track.gates_to_finish(laps) if race else 0,
        collision_distance=collision_distances(fleet) if race else (usual.collision_distance,),
        observation=observation,
        weights=_weights(options, usual),
        more_terms=more,
        randomisation=randomisation,
        sensing=usual.sensing if options.sensing is None else find_sensing(options.sensing),
        spread=find_spread(spread, track),
        limit=_limit(options, usual, Match(track, (), laps).time_limit / vehicle.control_dt),
        drones=drones,
        layout=observation_layout(observation, Setting(drones, len(track.gates), dynamics)),
        action=dynamics.action,
    )


def _weights(options: RaceOptions, usual: TrainConfig) -> RewardWeights:
    """Of the reward. Raises CruiseError where there is no such preset."""
    if options.reward is None:
        return usual.reward
    if isinstance(options.reward, RewardWeights):
        return options.reward
    if options.reward not in REWARDS:
        raise CruiseError(f"unknown reward {options.reward!r}; there are {', '.join(REWARDS)}")
    return REWARDS[options.reward]


def _stage(options: RaceOptions, vehicle: Vehicle) -> Stage:
    """Of the curriculum of a vehicle; for a real race the last. Raises CruiseError where there is no such stage."""
    curriculum = curriculum_of(vehicle)
    number = len(curriculum) if options.stage == RACE else options.stage
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= len(curriculum):
        raise CruiseError(f"stage must be from 1 to {len(curriculum)}, or {RACE!r}, got {options.stage!r}")
    return curriculum[number - 1]


def _agility(options: RaceOptions, vehicle: Vehicle) -> float:
    """The scale of a learner's actions. Raises CruiseError where it is none."""
    agility = _stage(options, vehicle).agility if options.agility is None else float(options.agility)
    if not (math.isfinite(agility) and agility > 0):
        raise CruiseError(f"agility must be above 0 and finite, got {agility}")
    return agility


def _drones(options: RaceOptions, everybody_learns: bool) -> int:
    if everybody_learns and options.opponents is not None:
        raise CruiseError("here every drone is an agent: opponents are for cruise/Race-v0 and for cruise.make")
    drones, several = options.drones, isinstance(options.opponents, list | tuple)
    if drones is None:
        vehicles = len(options.vehicle) if isinstance(options.vehicle, list | tuple) else 0
        others = len(options.opponents) + 1 if several else 2  # type: ignore[arg-type]
        drones = vehicles or 4 if everybody_learns else max(vehicles, others)
    if not 1 <= drones <= MAX_DRONES:
        raise CruiseError(f"drones must be from 1 to {MAX_DRONES}, got {drones}")
    if drones == 1 and options.opponents not in (None, [], ()):
        raise CruiseError("a race of 1 drone has no opponents")
    if several and len(options.opponents) >= max(drones, 2):  # type: ignore[arg-type]
        raise CruiseError(f"{len(options.opponents)} opponents in a race of {drones} drones: one learns")  # type: ignore[arg-type]
    return drones


def _opponents(options: RaceOptions, track: Track, fleet: tuple[Vehicle, ...]) -> tuple[PilotChoice, ...]:
    """Who flies the others. Policies are looked up here, and loaded where JAX may start."""
    choices = options.opponents
    if choices is None or (isinstance(choices, list | tuple) and not choices):
        choices = shipped_name(track.name, len(fleet), reference_to(fleet[0]))
    several: tuple[PilotChoice, ...] = tuple(choices) if isinstance(choices, list | tuple) else (choices,)  # type: ignore[assignment]
    for number, vehicle in enumerate(fleet[1:]):
        choice = several[number % len(several)]
        meta = pilot_meta(choice)
        if meta is not None and not fly_alike(find_vehicle(meta.vehicle), vehicle):
            made_in = find_vehicle(meta.vehicle).name
            raise CruiseError(f"opponent {choice!r} flies vehicle {made_in!r}, and this race {vehicle.name!r}")
    return several


def _laps(options: RaceOptions, track: Track) -> int:
    if options.laps is None:
        return track.laps
    if options.stage != RACE:
        raise CruiseError(f"laps are those of a real race: give stage={RACE!r} with them")
    if not 1 <= options.laps <= MAX_LAPS:
        raise CruiseError(f"laps must be from 1 to {MAX_LAPS}, got {options.laps}")
    return options.laps


def _randomisation(options: RaceOptions, usual: TrainConfig, vehicle: Vehicle) -> Randomisation:
    if options.randomise is not None:
        return find_randomisation(options.randomise, vehicle)
    return Randomisation() if options.stage == RACE else usual.randomisation


def _limit(options: RaceOptions, usual: TrainConfig, of_a_race: float) -> int:
    if options.episode_steps is None:
        return round(of_a_race) if options.stage == RACE else usual.episode_steps
    if options.episode_steps < 1:
        raise CruiseError(f"episode_steps must be 1 or more, got {options.episode_steps}")
    return options.episode_steps
