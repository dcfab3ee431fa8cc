"""What a race through an adapter is, as its user says it, and what follows from it."""

import dataclasses
import difflib
import functools
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp

from cruise.config import ObservationKind, RewardWeights, Stage, Track, TrainConfig, Vehicle
from cruise.env.observation import OBSERVATIONS, find_observation
from cruise.env.payment import find_reward_terms, make_reward
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.types import Rules, stage_rules
from cruise.errors import CruiseError
from cruise.evaluation.matches import MAX_DRONES, MAX_LAPS, Match, make_match
from cruise.evaluation.pilot_choice import PilotChoice
from cruise.pilots.base import Crew, Pilot, Versatile, crews
from cruise.pilots.foreign import Commanded
from cruise.pilots.terms_file import load_all_terms
from cruise.precision import single_precision
from cruise.presets import CURRICULUM, REWARDS, curriculum_of, training_config
from cruise.racing.track_file import load_track
from cruise.storage.policy_file import shipped_name
from cruise.vehicles import VehicleChoice, load_vehicle, reference_to

RACE = "race"
EPISODE_STEPS = 600  # time limit of an episode that is no race, in control steps


@dataclass(frozen=True)
class RaceOptions:
    """What is raced, by whom, and under which rules."""

    track: Track | str | os.PathLike[str] = "ring"
    """A track, the name of a built-in one, or the path of a TOML file."""
    drones: int | None = None
    """In a race. By default one more than opponents are named, or 2; in PettingZoo 4."""
    opponents: PilotChoice | Sequence[PilotChoice] | None = None
    """Who flies against the learner, as `cruise.race` takes pilots: one for all, or one each; fewer take turns. By
    default the policy shipped for this track and number of drones."""
    stage: int | Literal["race"] = len(CURRICULUM)
    """Rules and reward of a stage of the curriculum, 1 to 5, or of a real race: true openings, every collision final,
    a finish."""
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
    vehicle: VehicleChoice = "paper"
    """A vehicle, the name of a built-in one, or the path of a TOML file."""
    agility: float | None = None
    """Scale of the learner's action [m/s^2]. By default the stage's in the vehicle's curriculum."""
    episode_steps: int | None = None
    """Time limit in control steps, at which an episode is truncated. By default 600, or a race's usual limit."""

    def changed(self, changes: dict[str, Any]) -> "RaceOptions":
        """With some options changed. Raises CruiseError where there is no such option."""
        known = [field.name for field in dataclasses.fields(self)]
        for name in changes:
            if name not in known:
                close = difflib.get_close_matches(name, known, n=1)
                hint = f"did you mean {close[0]!r}? " if close else ""
                raise CruiseError(f"unknown option {name!r} of a race: {hint}options: {', '.join(known)}")
        return dataclasses.replace(self, **changes)


class Setup(NamedTuple):
    """Static choices of a race, its rules, and who flies."""

    env: RaceEnv
    track: Track
    vehicle: Vehicle
    observation: ObservationKind
    rules: Rules  # arrays
    learners: tuple[int, ...]  # drones that are flown from outside
    groups: tuple[Crew, ...]  # the learners' first
    limit: int  # of an episode, in control steps
    names: tuple[str, ...]  # of the drones' pilots


@single_precision
def set_up(options: RaceOptions, everybody_learns: bool) -> Setup:
    """What follows from the options.

    Raises:
        CruiseError: something does not exist, is out of range, or does not go together.
    """
    files = (options.terms,) if isinstance(options.terms, str | os.PathLike) else options.terms
    more = find_reward_terms(load_all_terms(files))
    track = options.track if isinstance(options.track, Track) else load_track(options.track)
    vehicle, stage, agility = _chosen(options)
    drones = _drones(options, everybody_learns)
    usual = training_config(vehicle, drones)
    observation, weights = _observation(options, usual), _weights(options, usual)
    learners = tuple(range(drones)) if everybody_learns else (0,)
    opponents = _opponents(options, track, vehicle, drones) if len(learners) < drones else ()
    laps = _laps(options, track)
    known = tuple(OBSERVATIONS.values())
    env = _race_env(track, drones, vehicle, observation, weights, more, known)
    scales = [agility] * len(learners) + [pilot.agility for pilot in opponents]
    rules = _rules(stage, vehicle, usual, laps * len(track.gates) + 1 if options.stage == RACE else 0)
    rules = rules._replace(agility=jnp.array(scales, jnp.float32)[:, None])
    others = (Crew(c.pilot, tuple(d + len(learners) for d in c.drones)) for c in crews(opponents))
    return Setup(
        env=env,
        track=track,
        vehicle=vehicle,
        observation=observation,
        rules=jax.tree.map(jnp.asarray, rules),
        learners=learners,
        groups=(Crew(Commanded(observation), learners), *others),
        limit=_limit(options, track, laps, vehicle),
        names=("learner",) * len(learners) + tuple(pilot.name for pilot in opponents),
    )


@functools.lru_cache(maxsize=16)
def _race_env(*choices: Any) -> RaceEnv:
    """The same environment for the same choices and known observations, so that nothing is compiled twice."""
    track, drones, vehicle, observation, weights, more, _ = choices
    return make_race_env(track, drones, vehicle, observation, make_reward(weights, more))


def _observation(options: RaceOptions, usual: TrainConfig) -> ObservationKind:
    """What the learner sees. Raises CruiseError where there is no such observation."""
    chosen = usual.observation if options.observation is None else options.observation
    find_observation(chosen)
    return chosen


def _weights(options: RaceOptions, usual: TrainConfig) -> RewardWeights:
    """Of the reward. Raises CruiseError where there is no such preset."""
    if options.reward is None:
        return usual.reward
    if isinstance(options.reward, RewardWeights):
        return options.reward
    _one_of("reward", options.reward, tuple(REWARDS))
    return REWARDS[options.reward]


def _chosen(options: RaceOptions) -> tuple[Vehicle, Stage, float]:
    """Vehicle, its stage and agility."""
    vehicle = load_vehicle(options.vehicle)
    curriculum = curriculum_of(vehicle)
    number = len(curriculum) if options.stage == RACE else options.stage
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= len(curriculum):
        raise CruiseError(f"stage must be from 1 to {len(curriculum)}, or {RACE!r}, got {options.stage!r}")
    stage = curriculum[number - 1]
    agility = stage.agility if options.agility is None else float(options.agility)
    if not (math.isfinite(agility) and agility > 0):
        raise CruiseError(f"agility must be above 0 and finite, got {agility}")
    return vehicle, stage, agility


def _one_of(name: str, value: object, known: Sequence[str]) -> None:
    if value not in known:
        raise CruiseError(f"unknown {name} {value!r}; there are {', '.join(known)}")


def _drones(options: RaceOptions, everybody_learns: bool) -> int:
    if everybody_learns and options.opponents is not None:
        raise CruiseError("in PettingZoo every drone is an agent: opponents are for cruise/Race-v0 in Gymnasium")
    drones = options.drones
    if drones is None:
        several = isinstance(options.opponents, list | tuple)
        drones = 4 if everybody_learns else len(options.opponents) + 1 if several else 2  # type: ignore[arg-type]
    if not 1 <= drones <= MAX_DRONES:
        raise CruiseError(f"drones must be from 1 to {MAX_DRONES}, got {drones}")
    if drones == 1 and options.opponents not in (None, [], ()):
        raise CruiseError("a race of 1 drone has no opponents")
    return drones


def _opponents(options: RaceOptions, track: Track, vehicle: Vehicle, drones: int) -> tuple[Pilot, ...]:
    choices = options.opponents
    if choices is None or (isinstance(choices, list | tuple) and not choices):
        choices = shipped_name(track.name, drones, reference_to(vehicle))
    several: list[Any] = list(choices) if isinstance(choices, list | tuple) else [choices]
    return make_match(track, drones - 1, [_aboard(one, vehicle) for one in several], vehicle=vehicle).team


def _aboard(choice: PilotChoice, vehicle: Vehicle) -> PilotChoice:
    """A pilot that can fly any vehicle, put into the one that is raced: the learner's."""
    ready = not isinstance(choice, type) and isinstance(choice, Pilot) and isinstance(choice, Versatile)
    return choice.for_vehicle(vehicle) if ready else choice  # type: ignore[union-attr]


def _laps(options: RaceOptions, track: Track) -> int:
    if options.laps is None:
        return track.laps
    if options.stage != RACE:
        raise CruiseError(f"laps are those of a real race: give stage={RACE!r} with them")
    if not 1 <= options.laps <= MAX_LAPS:
        raise CruiseError(f"laps must be from 1 to {MAX_LAPS}, got {options.laps}")
    return options.laps


def _rules(stage: Stage, vehicle: Vehicle, usual: TrainConfig, gates_to_finish: int) -> Rules:
    if not gates_to_finish:
        return stage_rules(stage, usual.collision_distance)
    strict = stage_rules(stage, vehicle.collision_distance)
    return strict._replace(gate_tolerance=0.0, terminal_collisions=True, gates_to_finish=gates_to_finish)


def _limit(options: RaceOptions, track: Track, laps: int, vehicle: Vehicle) -> int:
    if options.episode_steps is not None:
        if options.episode_steps < 1:
            raise CruiseError(f"episode_steps must be 1 or more, got {options.episode_steps}")
        return options.episode_steps
    if options.stage == RACE:
        return round(Match(track, (), laps).time_limit / vehicle.control_dt)
    return EPISODE_STEPS
