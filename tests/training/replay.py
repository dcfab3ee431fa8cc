"""A rollout flown again step by step in plain Python: networks in NumPy, bookkeeping race by race."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState, Rules
from cruise.pilots.network import ActorCritic
from cruise.pilots.scripted import Chaser
from cruise.training.types import TrainState
from tests.training import reference
from tests.training.runs import TINY, tiny_trainer


class Replayed(NamedTuple):
    """What the active drones lived through, time leading, and where the races stand after it."""

    transitions: dict[str, np.ndarray]  # by the names of `Transitions`
    last_value: np.ndarray
    races: RaceState
    uses_previous: np.ndarray
    restarted: np.ndarray  # [T, E]


@functools.cache
def compiled_env() -> RaceEnv:
    """The tiny run's environment, one step at a time."""
    env = tiny_trainer().env
    functions = {name: jax.jit(getattr(env, name)) for name in ("step", "observe", "decode")}
    return env._replace(**functions, reset=jax.jit(env.reset, static_argnums=1))


def fly(env: RaceEnv, races: RaceState, actions: np.ndarray, rules: Rules) -> tuple:
    """One control step of actions [A, N, E] in the policy's frame."""
    return env.step(races, env.decode(races, jnp.asarray(actions, jnp.float32)), rules)


@functools.cache
def chase():
    """Actions of chasers, compiled."""
    command = functools.partial(Chaser().command, compiled_env())
    return jax.jit(lambda races, sparring, agility: command(races, sparring.speed, sparring.push, agility))


def networks_actions(model: ActorCritic, observation: np.ndarray) -> np.ndarray:
    """Mean actions [A, E] of observations [O, E]."""
    return reference.mean_action(model, observation)


def replay(before: TrainState, starts: RaceState, rules: Rules, alone: bool, own_actions: np.ndarray) -> Replayed:
    """Fly a rollout from `before`, the active drones by the actions [T, A, E] that were drawn; race e begins anew from
    start e."""
    env = compiled_env()
    races, restart = numpy_copy(before.races), np.array(before.restart)
    older = np.array(before.opponents.uses_previous)
    starts = numpy_copy(starts)
    starts.out[1:] |= alone
    lived: list[dict] = []
    for action in own_actions:
        for e in np.flatnonzero(restart):
            begin(races, starts, race=e)
        older &= ~restart
        observation = np.asarray(env.observe(races))
        opponents = {use: networks_actions(model, observation[:, 1]) for use, model in generations(before)}
        nearest = np.array([nearest_opponent(races, e) for e in range(older.size)], np.float64)
        theirs = np.where(older, opponents[True], opponents[False])
        flown = np.array(env.decode(races, np.stack([action, theirs], axis=1).astype(np.float32)))
        by_hand = np.asarray(before.sparring.speed[1]) > 0
        flown[:, 1, by_hand] = np.asarray(chase()(races, before.sparring, rules.agility))[:, 1, by_hand]
        races, outcome = env.step(races, jnp.asarray(flown), rules)
        row = transition(before.model, observation[:, 0], action, nearest, outcome)
        lived.append(row | {"restarted": restart})
        races, restart = numpy_copy(races), np.asarray(outcome.terminated[0])
    columns = {name: np.stack([row[name] for row in lived]) for name in lived[0]}
    restarted = columns.pop("restarted")
    following = numpy_copy(races)
    for e in np.flatnonzero(restart):
        begin(following, starts, race=e)
    last_value = reference.value(before.model, env.observe(following)[:, 0])
    return Replayed(columns, last_value, races, older, restarted)


def nearest_opponent(races: RaceState, race: int) -> float:
    """How far from the active drone its nearest opponent in the air is."""
    airborne = ~(races.out | races.finished)[1:, race]
    separations = np.linalg.norm(np.diff(races.drones.body.position_w[:, :2, race], axis=1), axis=0)
    return min([np.inf, *separations[airborne]])


def transition(
    model: ActorCritic, observation: np.ndarray, action: np.ndarray, nearest: np.ndarray, outcome
) -> dict[str, np.ndarray]:
    """One step as `Transitions` names it."""
    mean = reference.mean_action(model, observation)
    scale = np.clip(nearest / TINY.ppo.caution_distance, TINY.ppo.least_noise, 1.0)
    return {
        "observation": observation,
        "action": action,
        "noise_scale": scale,
        "in_company": nearest < TINY.ppo.company_distance,
        "log_prob": reference.log_prob(mean, model.log_std, np.float64(action), scale),
        "value": reference.value(model, observation),
        "reward": np.asarray(outcome.reward[0]),
        "terminated": np.asarray(outcome.terminated[0]),
    }


def generations(state: TrainState) -> list[tuple[bool, ActorCritic]]:
    """(whether it is the previous one, the frozen policy)."""
    return [(False, state.opponents.newest), (True, state.opponents.previous)]


def begin(races: RaceState, starts: RaceState, race: int) -> None:
    """Race number `race` becomes its start, in place."""
    for now, start in zip(jax.tree.leaves(races), jax.tree.leaves(starts), strict=True):
        now[..., race] = start[..., race]


def numpy_copy(races: RaceState) -> RaceState:
    """The same in arrays that can be written to."""
    return jax.tree.map(np.array, races)
