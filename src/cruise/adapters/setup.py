"""A race as JAX flies it, from what was chosen."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from cruise.adapters.compiled import Plan, Reset
from cruise.adapters.options import Choices
from cruise.env.observation import OBSERVATIONS
from cruise.env.payment import make_reward
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.randomise import made_for, perturbation
from cruise.env.types import Rules, stage_rules
from cruise.evaluation.matches import make_match
from cruise.evaluation.pilot_choice import PilotChoice
from cruise.pilots.base import Crew, Pilot, Versatile, crews
from cruise.pilots.foreign import Commanded
from cruise.pilots.python_pilot import PythonPilots, separate_python_pilots
from cruise.precision import single_precision


class Setup(NamedTuple):
    """Static choices of a race, its rules, and who flies."""

    env: RaceEnv
    plan: Plan
    rules: Rules  # arrays
    names: tuple[str, ...]  # of the drones' pilots
    python_pilots: PythonPilots  # among the opponents


@single_precision
def set_up(choices: Choices, mode: Reset) -> Setup:
    """The race of the choices, whose episodes begin anew as the mode says.

    Raises:
        CruiseError: an opponent cannot be loaded, or does not fit the race.
    """
    env = _race_env(_static(choices), tuple(OBSERVATIONS.values()))
    opponents = _flown(choices)
    learners = choices.learners
    others = (Crew(c.pilot, tuple(d + len(learners) for d in c.drones)) for c in crews(opponents))
    groups = (Crew(Commanded(choices.observation), learners), *others)
    groups, python_pilots = separate_python_pilots(env, groups)
    scales = [choices.agility] * len(learners) + [pilot.agility for pilot in opponents]
    return Setup(
        env=env,
        plan=Plan(env, groups, learners, choices.observation, mode, jnp.int32(choices.limit)),
        rules=jax.tree.map(jnp.asarray, _rules(choices, jnp.array(scales, jnp.float32)[:, None])),
        names=("learner",) * len(learners) + tuple(pilot.name for pilot in opponents),
        python_pilots=python_pilots,
    )


def _static(choices: Choices) -> Choices:
    """Without what only the rules hold, which are traced."""
    nothing = {"opponents": (), "agility": 0.0, "limit": 0, "stage": None}
    return choices._replace(**nothing, gates_to_finish=0, collision_distance=0.0)  # type: ignore[arg-type]


@functools.lru_cache(maxsize=16)
def _race_env(choices: Choices, known: tuple) -> RaceEnv:
    """The same environment for the same choices and known observations, so that nothing is compiled twice."""
    vehicle = made_for(choices.vehicle, choices.randomisation)
    reward = make_reward(choices.weights, choices.more_terms)
    perturb = perturbation(choices.track, vehicle, choices.randomisation)
    return make_race_env(choices.track, choices.drones, vehicle, choices.observation, reward, perturb)


def _flown(choices: Choices) -> tuple[Pilot, ...]:
    """Who flies the opponents, one pilot per drone."""
    number, vehicle = choices.drones - len(choices.learners), choices.vehicle
    if not number:
        return ()
    return make_match(choices.track, number, [_aboard(c, choices) for c in choices.opponents], vehicle=vehicle).team


def _aboard(choice: PilotChoice, choices: Choices) -> PilotChoice:
    """A pilot that can fly any vehicle, put into the one that is raced: the learner's."""
    ready = not isinstance(choice, type) and isinstance(choice, Pilot) and isinstance(choice, Versatile)
    return choice.for_vehicle(choices.vehicle) if ready else choice  # type: ignore[union-attr]


def _rules(choices: Choices, agility: Array) -> Rules:
    """Those of the stage; a real race has true openings, and every collision is final."""
    rules = stage_rules(choices.stage, choices.collision_distance)._replace(agility=agility)
    if not choices.gates_to_finish:
        return rules
    return rules._replace(gate_tolerance=0.0, terminal_collisions=True, gates_to_finish=choices.gates_to_finish)
