"""A race as JAX flies it, from what was chosen."""

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from cruise.adapters.compiled import Plan, Reset
from cruise.adapters.options import Choices
from cruise.config import Vehicle
from cruise.env.mixed import Fleet
from cruise.env.observation import OBSERVATIONS
from cruise.env.payment import make_reward
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.randomise import made_for, perturbation
from cruise.env.types import Rules, stage_rules
from cruise.evaluation.matches import make_match
from cruise.evaluation.pilot_choice import PilotChoice, identity
from cruise.pilots.base import Crew, Pilot, Versatile, crews
from cruise.pilots.foreign import Commanded
from cruise.pilots.python_pilot import PythonPilots, separate_python_pilots
from cruise.precision import single_precision
from cruise.storage.race_log import flown_in


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
    learners, fleet = choices.learners, choices.fleet
    opponents, first = _flown(choices), len(learners)
    own = crews((Commanded(choices.observation),) * first, fleet[:first])
    others = (Crew(c.pilot, tuple(d + first for d in c.drones)) for c in crews(opponents, fleet[first:]))
    groups, python_pilots = separate_python_pilots(env, (*own, *others))
    scales = [*choices.agility, *(pilot.agility for pilot in opponents)]
    plan = Plan(
        env=env,
        groups=groups,
        commanded=len(own),
        learners=learners,
        observation=choices.observation,
        mode=mode,
        limit=jnp.int32(choices.limit),
        race=choices.gates_to_finish > 0,
        spread=choices.spread,
    )
    names = ("learner",) * first + tuple(pilot.name for pilot in opponents)
    return Setup(
        env=env,
        plan=plan,
        rules=jax.tree.map(jnp.asarray, _rules(choices, scales)),
        names=flown_in(names, [vehicle.name for vehicle in fleet]),
        python_pilots=python_pilots,
    )


def _static(choices: Choices) -> Choices:
    """Without what only the rules hold, which are traced."""
    nothing = {"opponents": (), "agility": (), "limit": 0, "stage": None, "spread": 0.0}
    return choices._replace(**nothing, gates_to_finish=0, collision_distance=())  # type: ignore[arg-type]


@functools.lru_cache(maxsize=16)
def _race_env(choices: Choices, known: tuple) -> RaceEnv:
    """The same environment for the same choices and known observations, so that nothing is compiled twice."""
    fleet = tuple(made_for(vehicle, choices.randomisation) for vehicle in choices.fleet)
    reward = make_reward(choices.weights, choices.more_terms)
    perturb = perturbation(choices.track, _one_or_each(fleet), choices.randomisation, sensing=choices.sensing)
    return make_race_env(choices.track, choices.drones, fleet, choices.observation, reward, perturb)


def _one_or_each(fleet: tuple[Vehicle, ...]) -> Fleet:
    return fleet[0] if len(set(fleet)) == 1 else fleet


def _flown(choices: Choices) -> tuple[Pilot, ...]:
    """Who flies the opponents, one pilot per drone."""
    fleet = choices.fleet[len(choices.learners) :]
    if not fleet:
        return ()
    turns = itertools.islice(itertools.cycle(choices.opponents), len(fleet))
    found: dict = {}
    team = [found.setdefault((identity(c), v), _aboard(c, v)) for c, v in zip(turns, fleet, strict=True)]
    return make_match(choices.track, len(fleet), team, vehicle=fleet).team


def _aboard(choice: PilotChoice, vehicle: Vehicle) -> PilotChoice:
    """A pilot that can fly any vehicle, put into the one that it is to fly."""
    ready = not isinstance(choice, type) and isinstance(choice, Pilot) and isinstance(choice, Versatile)
    return choice.for_vehicle(vehicle) if ready else choice  # type: ignore[union-attr]


def _rules(choices: Choices, scales: Sequence[float]) -> Rules:
    """Those of the stage; a real race has true openings, and every collision is final."""
    agility, apart = (jnp.array(values, jnp.float32)[:, None] for values in (scales, choices.collision_distance))
    distance = apart if len(apart) > 1 else choices.collision_distance[0]
    rules = stage_rules(choices.stage, choices.collision_distance[0])._replace(
        agility=agility, collision_distance=distance
    )
    if not choices.gates_to_finish:
        return rules
    return rules._replace(gate_tolerance=0.0, terminal_collisions=True, gates_to_finish=choices.gates_to_finish)
