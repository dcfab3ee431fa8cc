"""Iterative self-play: the win rate against the frozen opponents, and their replacement (Algorithm 1)."""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from cruise.config import SelfPlayConfig
from cruise.env.race_env import RaceEnv
from cruise.env.surroundings import perceive
from cruise.env.types import RaceState, Rules
from cruise.pilots.network import ActorCritic
from cruise.training.experience import hide_opponents
from cruise.training.league import SHARES, SLOTS, beaten_by_slot, opponents_fly
from cruise.training.types import ACTIVE, League, OpponentPool, TrainState
from cruise.vector import norm


class Score(NamedTuple):
    """How the active policy did in one evaluation. NaN where nothing was measured."""

    win_rate: Float[Array, ""] | float
    success: Float[Array, ""] | float  # share of races the active drone survived
    speed: Float[Array, ""] | float  # mean of the active drone while in the air [m/s]
    lap_time: Float[Array, ""] | float  # from the gates passed by survivors [s]
    beaten: Float[Array, "S"] | None = None  # how often each member of the league that flew was beaten


def win_rate(gates_passed: Int[Array, "N E"]) -> Float[Array, ""]:
    """w: the share of races in which the active drone passed more gates than every opponent."""
    if gates_passed.shape[0] == 1:
        return jnp.zeros(())
    return jnp.mean(gates_passed[ACTIVE] > gates_passed[ACTIVE + 1 :].max(0))


class _Watch(NamedTuple):
    """What an evaluation remembers of the active drone, race by race."""

    first_gate: Float[Array, "E"]  # step at which it passed its first gate, interpolated
    last_gate: Float[Array, "E"]
    distance: Float[Array, "E"]  # sum of its speeds
    steps: Float[Array, "E"]  # in the air


def _watch(seen: _Watch, before: RaceState, after: RaceState, passed: Bool[Array, "E"], fraction: Array) -> _Watch:
    flying = before.airborne[ACTIVE]
    moment = before.step + fraction
    first = before.gates_passed[ACTIVE] == 0
    return _Watch(
        first_gate=jnp.where(passed & first, moment, seen.first_gate),
        last_gate=jnp.where(passed, moment, seen.last_gate),
        distance=seen.distance + jnp.where(flying, norm(after.drones.velocity_w[:, ACTIVE]), 0.0),
        steps=seen.steps + flying,
    )


def _score(seen: _Watch, races: RaceState, env: RaceEnv, league: League | None = None) -> Score:
    gates = races.gates_passed[ACTIVE] - 1
    whole = (gates >= env.course.num_gates) & ~races.out[ACTIVE]
    per_lap = (seen.last_gate - seen.first_gate) * env.course.num_gates / jnp.maximum(gates, 1)
    return Score(
        win_rate=win_rate(races.gates_passed if league is None else _against_newest(races.gates_passed)),
        success=jnp.mean(~races.out[ACTIVE]),
        speed=seen.distance.sum() / jnp.maximum(seen.steps.sum(), 1),
        lap_time=jnp.sum(jnp.where(whole, per_lap, 0.0)) / whole.sum() * env.dynamics.control_dt,
        beaten=None if league is None else beaten_by_slot(races.gates_passed),
    )


def _against_newest(gates_passed: Int[Array, "N E"]) -> Int[Array, "N H"]:
    """Of the races that no member of the league flies in."""
    return gates_passed.reshape(len(gates_passed), -1, SHARES)[..., :SLOTS].reshape(len(gates_passed), -1)


Evaluate = Callable[..., Score]  # (model, opponents, rules, alone, key, league=None)


def make_evaluate(env: RaceEnv, config: SelfPlayConfig) -> Evaluate:
    """A function that races the active policy against the opponents, all deterministic, under the stage's rules.

    With a league its members fly the opponents of as many races as the newest do, and races are a few more: a multiple
    of their shares.
    """

    def evaluate(
        model: ActorCritic, opponents: ActorCritic, rules: Rules, alone: Array, key: Array, league: League | None = None
    ) -> Score:
        number = config.evaluation_races if league is None else SHARES * math.ceil(config.evaluation_races / SHARES)
        races = hide_opponents(env.reset(key, (number,)), alone)
        nothing = jnp.zeros(number)
        pool = OpponentPool(opponents, opponents, jnp.zeros(number, bool), jnp.zeros((), jnp.int32))

        def step(carry: tuple, _: None) -> tuple:
            races, seen, own, theirs = carry
            measured = perceive(races)
            observation = env.observe(measured)
            own, action = model.apply(own, observation[:, :1])
            if env.num_drones > 1:
                theirs, others = opponents_fly(pool, league, theirs, observation[:, 1:])
                action = jnp.concatenate([action, others], axis=1)
            after, outcome = env.step(races, env.decode(measured, action), rules)
            crossing = outcome.crossing
            seen = _watch(seen, races, after, crossing.passed[ACTIVE], crossing.fraction[ACTIVE])
            return (after, seen, own, theirs), None

        carries = model.init_carry((1, number)), opponents.init_carry((env.num_drones - 1, number))
        start = (races, _Watch(*[nothing] * 4), *carries)
        (races, seen, _, _), _ = jax.lax.scan(step, start, length=config.evaluation_steps)
        return _score(seen, races, env, league)

    return evaluate


def replace_opponents(state: TrainState) -> TrainState:
    """phi_i <- theta_a. Races under way keep their opponents until they end."""
    pool = state.opponents
    everywhere = jnp.ones_like(pool.uses_previous)
    return state._replace(opponents=OpponentPool(state.policy, pool.newest, everywhere, jnp.zeros_like(pool.failed)))


def play_on(state: TrainState) -> TrainState:
    """The opponents stay; count it."""
    pool = state.opponents
    return state._replace(opponents=pool._replace(failed=pool.failed + 1))


def has_mastered(state: TrainState, score: Score, config: SelfPlayConfig) -> bool:
    """Algorithm 1's condition w >= tau, or patience run out.

    Against three equals a win rate of 0.6 may never come: without patience the active policy would go on learning to
    race opponents that fly as nobody does any more.
    """
    impatient = 0 < config.patience <= int(state.opponents.failed) + 1
    return impatient or bool(score.win_rate >= config.win_threshold)


def may_replace(state: TrainState) -> bool:
    """Whether no race still flies against the generation that a replacement would drop."""
    return not bool(state.opponents.uses_previous.any())
