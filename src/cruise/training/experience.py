"""Collect experience of one active policy against frozen opponents."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState, Rules, StepOutcome
from cruise.pilots.network import ActorCritic
from cruise.training.types import OpponentPool, TrainState, Transitions

ACTIVE = 0  # the drone that learns; it starts in a random lane, so it is no special place


class Experience(NamedTuple):
    """A rollout, the value after its last step, and what to log."""

    transitions: Transitions
    last_value: Float[Array, "E"]
    metrics: dict[str, Array]


Collect = Callable[[TrainState, Rules, Array], tuple[TrainState, Experience]]


def log_prob(mean: Array, log_std: Array, action: Float[Array, "A *B"]) -> Float[Array, "*B"]:
    """Log-density of an action under the diagonal Gaussian policy."""
    std = jnp.exp(log_std).reshape(-1, *(1,) * (action.ndim - 1))
    return jax.scipy.stats.norm.logpdf(action, mean, std).sum(0)


def opponent_actions(pool: OpponentPool, observation: Float[Array, "O K E"]) -> Float[Array, "A K E"]:
    """Deterministic actions of the frozen drones; the older generation costs only while a race still uses it."""
    newest = pool.newest.mean_action(observation)

    def mixed(_: None) -> Array:
        return jnp.where(pool.uses_previous, pool.previous.mean_action(observation), newest)

    return jax.lax.cond(pool.uses_previous.any(), mixed, lambda _: newest, None)


def begin_again(races: RaceState, start: RaceState, restart: Bool[Array, "E"]) -> RaceState:
    """Races in `restart` continue from their new start."""
    return jax.tree.map(lambda new, old: jnp.where(restart, new, old), start, races)


def hide_opponents(races: RaceState, alone: Array) -> RaceState:
    """Where `alone`, the active drone flies without opponents: they never take off."""
    grounded = (jnp.arange(races.out.shape[0]) != ACTIVE)[:, None] & alone
    return races._replace(out=races.out | grounded)


def _step_metrics(outcome: StepOutcome, races: RaceState) -> dict[str, Array]:
    speed = jnp.sqrt(sum(v * v for v in races.drones.velocity_w[:, ACTIVE]))
    metrics = {f"reward/{name}": value[ACTIVE].mean() for name, value in outcome.components.items()}
    metrics |= {f"collision/{name}": hit[ACTIVE].mean() for name, hit in outcome.collisions._asdict().items()}
    return metrics | {
        "reward": outcome.reward[ACTIVE].mean(),
        "speed": speed.mean(),
        "gates_passed": outcome.crossing.passed[ACTIVE].mean(),
        "gates_missed": outcome.crossing.missed[ACTIVE].mean(),
        "terminated": outcome.terminated[ACTIVE].mean(),
    }


def make_collect(env: RaceEnv, num_races: int, rollout_steps: int, episode_steps: int) -> Collect:
    """A function that flies every race for `rollout_steps` steps.

    Starts come from a pool drawn once per rollout: at step t race e would start from entry e + t, so that a reset is
    a copy of a contiguous slice. The time limit is looked at when the rollout ends, where the value after the last
    step is computed in any case: truncation costs nothing and is bootstrapped exactly.
    """

    def start_pool(key: Array, alone: Array) -> RaceState:
        fresh = hide_opponents(env.reset(key, (num_races,)), alone)
        return jax.tree.map(lambda x: jnp.concatenate([x, x[..., :rollout_steps]], axis=-1), fresh)

    def collect(state: TrainState, rules: Rules, alone: Array) -> tuple[TrainState, Experience]:
        key, start_key, noise_key = jax.random.split(state.key, 3)
        pool = start_pool(start_key, alone)
        noise = jax.random.normal(noise_key, (rollout_steps, env.dynamics.action_size, num_races))
        model: ActorCritic = state.model
        std = jnp.exp(model.log_std)[:, None]

        def step(carry: tuple, t_noise: tuple) -> tuple:
            races, restart, opponents = carry
            t, white = t_noise
            start = jax.tree.map(lambda x: jax.lax.dynamic_slice_in_dim(x, t, num_races, axis=-1), pool)
            races = begin_again(races, start, restart)
            opponents = opponents._replace(uses_previous=opponents.uses_previous & ~restart)
            observation = env.observe(races)
            own = observation[:, ACTIVE]
            mean, value = model.mean_action(own), model.value(own)
            action = mean + std * white
            everyone = action[:, None]
            if env.num_drones > 1:
                everyone = jnp.concatenate([everyone, opponent_actions(opponents, observation[:, 1:])], axis=1)
            races, outcome = env.step(races, env.decode(races.next_gate, everyone), rules)
            terminated = outcome.terminated[ACTIVE]
            transition = Transitions(
                own, action, log_prob(mean, model.log_std, action), value, outcome.reward[ACTIVE], terminated
            )
            return (races, terminated, opponents), (transition, _step_metrics(outcome, races))

        carry = (state.races, state.restart, state.opponents)
        steps = (jnp.arange(rollout_steps), noise)
        transitions: Transitions
        step_metrics: dict[str, Array]
        (races, terminated, opponents), (transitions, step_metrics) = jax.lax.scan(step, carry, steps)
        last_value = model.value(env.observe(races)[:, ACTIVE])
        truncated = ~terminated & (races.step >= episode_steps)
        metrics = {name: values.mean() for name, values in step_metrics.items()}
        metrics["truncated"] = truncated.mean() / rollout_steps
        state = state._replace(races=races, restart=terminated | truncated, opponents=opponents, key=key)
        return state, Experience(transitions, last_value, metrics)

    return collect
