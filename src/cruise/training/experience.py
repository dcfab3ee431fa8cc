"""Collect experience of one active policy against frozen opponents."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Shaped

from cruise.config import TrainConfig
from cruise.env.race_env import RaceEnv
from cruise.env.surroundings import perceive
from cruise.env.types import RaceState, Rules, StepOutcome
from cruise.pilots.network import ActorCritic, Carries, emptied
from cruise.training.league import opponents_fly
from cruise.training.sparring import fly_sparring
from cruise.training.types import ACTIVE, TrainState, Transitions
from cruise.vector import norm


class Draws(NamedTuple):
    """The random numbers of a rollout, drawn beforehand for all races: where they lie does not change them."""

    start: RaceState  # [..., N, E]; a race that begins anew in this rollout begins here
    noise: Float[Array, "T A K E"]  # white, of the actions of those who learn
    retry: Bool[Array, "E"]  # a race that crashes goes on from where this rollout began


class Experience(NamedTuple):
    """A rollout, the value of what follows its last step, and what to log."""

    transitions: Transitions
    last_value: Float[Array, "E"]
    metrics: dict[str, Array]
    carries: Carries | None = None  # what the networks remembered before it, where they remember anything


Collect = Callable[[TrainState, Draws, Rules, Array], tuple[TrainState, Experience]]


def log_prob(
    mean: Array, log_std: Array, action: Float[Array, "A *B"], noise_scale: Array | float = 1.0
) -> Float[Array, "*B"]:
    """Log-density of an action under the diagonal Gaussian policy, its deviation times `noise_scale` [*B]."""
    std = jnp.exp(log_std).reshape(-1, *(1,) * (action.ndim - 1)) * noise_scale
    return jax.scipy.stats.norm.logpdf(action, mean, std).sum(0)


def nearest_opponent(races: RaceState, drone: int = ACTIVE) -> Float[Array, "E"]:
    """How far from a drone the nearest opponent in the air is [m]; infinitely where there is none."""
    position, airborne = races.drones.position_w, races.airborne
    nearest = jnp.full(airborne.shape[1:], jnp.inf)
    for k in range(airborne.shape[0]):
        if k != drone:
            separation = norm(position[:, k] - position[:, drone])
            nearest = jnp.minimum(nearest, jnp.where(airborne[k], separation, jnp.inf))
    return nearest


def caution(nearest: Float[Array, "*B"], distance: float, least: float) -> Float[Array, "*B"]:
    """What is left of the active drone's noise with an opponent near: its distance over `distance` [m], never all gone.

    Wide noise finds fast flight, which narrow noise does not; but beside an opponent it means a crash, whatever the
    policy means to do, and what the policy means to do could not be learned from crashes by chance.
    """
    return jnp.clip(nearest / distance, least, 1.0) if distance > 0 else jnp.ones_like(nearest)


def of_learners(learners: int, values: Shaped[Array, "*C N E"]) -> Shaped[Array, "*C KE"]:
    """The rows of those who learn, one behind the other."""
    return values[..., :learners, :].reshape(*values.shape[:-2], -1)


def ends_race(crashed: Bool[Array, "K E"]) -> Bool[Array, "E"]:
    """Whether a race begins anew: a crash of the active drone ends it; where all learn, one of the first half of them.

    If every crash did, nobody would fly far before all fly well; if only the last did, half of them would lie about.
    """
    return crashed[: max(1, len(crashed) // 2)].any(0)


def begin_again(races: RaceState, start: RaceState, restart: Bool[Array, "E"]) -> RaceState:
    """Races in `restart` continue from their new start."""
    return jax.tree.map(lambda new, old: jnp.where(restart, new, old), start, races)


def or_from_here(start: RaceState, state: TrainState, retry: Bool[Array, "E"]) -> RaceState:
    """Where a race that crashes begins again: at `start`, or with `retry` where it is now, a moment before the crash.

    So what a race crashes in is tried again until it is flown, and hard places are met more often than easy ones.
    """
    return begin_again(start, state.races, retry & ~state.restart)


def hide_opponents(races: RaceState, alone: Array) -> RaceState:
    """Where `alone`, the active drone flies without opponents: they never take off."""
    grounded = (jnp.arange(races.out.shape[0]) != ACTIVE)[:, None] & alone
    return races._replace(out=races.out | grounded)


def thin_out(races: RaceState, key: Array) -> RaceState:
    """From none to all of the opponents of each race take off, each number as often."""
    drones = races.out.shape[0]
    opponents = jax.random.randint(key, races.out.shape[1:], 0, drones)
    return races._replace(out=races.out | (jnp.arange(drones)[:, None] > ACTIVE + opponents))


def _step_metrics(outcome: StepOutcome, races: RaceState) -> dict[str, Shaped[Array, "E"]]:
    """What is logged of the active drone, race by race."""
    metrics = {f"reward/{name}": value[ACTIVE] for name, value in outcome.components.items()}
    metrics |= {f"collision/{name}": hit[ACTIVE] for name, hit in outcome.collisions._asdict().items()}
    return metrics | {
        "reward": outcome.reward[ACTIVE],
        "speed": norm(races.drones.velocity_w[:, ACTIVE]),
        "gates_passed": outcome.crossing.passed[ACTIVE],
        "gates_missed": outcome.crossing.missed[ACTIVE],
        "terminated": outcome.terminated[ACTIVE],
    }


def spread_of(env: RaceEnv, config: TrainConfig) -> float:
    """The share of starts all along the track: none where they are before every gate as it is."""
    return 0.0 if env.track.start is None else config.spread_starts


def draw(env: RaceEnv, key: Array, config: TrainConfig) -> Draws:
    """Starts and noise of one rollout.

    One start per race: one that ends twice in a rollout begins at the same place twice, which costs nothing, where a
    fresh start for every race at every step would cost more than everything else together.
    """
    start_key, noise_key, field_key, retry_key = jax.random.split(key, 4)
    races = config.ppo.races
    noise = jax.random.normal(noise_key, (config.ppo.rollout_steps, env.dynamics.action_size, config.learners, races))
    start = env.reset(start_key, (races,), spread=spread_of(env, config))
    again = jax.random.uniform(retry_key, (races,)) < config.retry_share
    return Draws(thin_out(start, field_key) if config.opponents.vary_field else start, noise, again)


def make_collect(env: RaceEnv, config: TrainConfig) -> Collect:
    """A function that flies every race for as many steps as there is noise for.

    The time limit is looked at when the rollout ends, where the value after the last step is computed in any case:
    truncation costs nothing and is bootstrapped exactly.
    """
    ppo, learners, judge = config.ppo, config.learners, _judge(env, config)
    flat = functools.partial(of_learners, learners)
    spars = env.num_drones > 1 and config.opponents.sparring_share > 0 and config.opponents.self_play != "off"

    def collect(state: TrainState, draws: Draws, rules: Rules, alone: Array) -> tuple[TrainState, Experience]:
        start = hide_opponents(draws.start, alone)
        if config.retry_share:
            start = or_from_here(start, state, draws.retry)
        model: ActorCritic = state.model
        std = jnp.exp(model.log_std)[:, None]

        def step(carry: tuple, white: Array) -> tuple:
            races, restart, opponents, carries, theirs = carry
            races = begin_again(races, start, restart)
            opponents = opponents._replace(uses_previous=opponents.uses_previous & ~restart)
            carries, theirs = emptied((carries, theirs), restart)
            seen = perceive(races)
            observation = env.observe(seen)
            own, judged = flat(observation), judge(races)
            carries, mean, value = model.act_and_judge(carries, own, judged)
            nearest = jnp.concatenate([nearest_opponent(races, drone) for drone in range(learners)])
            noise_scale = caution(nearest, ppo.caution_distance, ppo.least_noise)
            action = mean + std * noise_scale * flat(white)
            everyone = action.reshape(-1, learners, len(restart))
            if env.num_drones > learners:
                theirs, others = opponents_fly(opponents, state.league, theirs, observation[:, 1:])
                everyone = jnp.concatenate([everyone, others], axis=1)
            flown = env.decode(seen, everyone)
            flies_itself = races.airborne & (state.sparring.speed == 0)
            if spars:
                flown = fly_sparring(env, seen, flown, state.sparring, rules.agility)
            races, outcome = env.step(races, flown, rules)
            crashed = outcome.terminated[:learners]
            over = ends_race(crashed)
            density, company = log_prob(mean, model.log_std, action, noise_scale), nearest < ppo.company_distance
            transition = Transitions(
                observation=own,
                action=action,
                noise_scale=noise_scale,
                in_company=company,
                log_prob=density,
                value=value,
                reward=flat(outcome.reward),
                terminated=flat(outcome.terminated),
                judged=judged,
                begins=restart if model.has_memory else None,
            )
            if learners > 1:
                cut = over & ~crashed
                transition = transition._replace(counts=flat(flies_itself & ~cut), cut=flat(cut))
            return (races, over, opponents, carries, theirs), (transition, _step_metrics(outcome, races))

        begun = (state.races, state.restart, state.opponents, state.carries, state.opponents_carry)
        lived: tuple[Transitions, dict[str, Array]]
        ended, lived = jax.lax.scan(step, begun, draws.noise)
        races, over, opponents, carries, theirs = ended
        following = begin_again(races, start, over)
        last = judge(following)
        last = flat(env.observe(perceive(following))) if last is None else last
        _, last_value = model.critic.step(emptied(carries.critic, over), last)
        truncated = ~over & (races.step >= config.episode_steps)
        metrics = {name: values.mean() for name, values in lived[1].items()}
        metrics["truncated"] = truncated.mean() / len(draws.noise)
        before = state.carries if model.has_memory else None
        return state._replace(
            races=races, restart=over | truncated, opponents=opponents, carries=carries, opponents_carry=theirs
        ), Experience(lived[0], last_value[0], metrics, before)

    return collect


def _judge(env: RaceEnv, config: TrainConfig) -> Callable[[RaceState], Array | None]:
    """What the value network sees of every learner: None where it sees what the policy sees.

    An observation of its own is of the true state: sensor errors are for the policy, which must learn to live with
    them, not for who judges it (Pinto et al., Asymmetric Actor Critic, RSS 2018).
    """
    if not config.critic_observation:
        return lambda races: None
    observe = env.observe_as[config.critic_observation]
    return lambda races: of_learners(config.learners, observe(races))
