"""Problems so small that the right value and the right action are known: does the learner find them?"""

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import PPOConfig
from cruise.pilots.network import ActorCritic, NetworkShape
from cruise.training.experience import Experience, log_prob
from cruise.training.ppo import exploration_schedule, flatten, make_learn, make_optimiser
from cruise.training.types import TrainState, Transitions

STEPS, RACES, UPDATES, GAMMA = 16, 16, 150, 0.5
CONFIG = PPOConfig(
    races=RACES,
    rollout_steps=STEPS,
    minibatches=4,
    learning_rate=1e-2,
    final_learning_rate=1e-3,
    gamma=GAMMA,
    after_crash="nothing",
    hidden=(16, 16),
)


class Problem(NamedTuple):
    """Reward = bonus + slope o - cost |a - target - tilt o|^2, for one observation o and two actions a.

    Where o is positive an opponent is near, and chance of deviation `luck` comes on top.
    """

    observation: np.ndarray  # [T, E]
    last_observation: np.ndarray  # [E]
    terminated: np.ndarray  # [T, E]
    bonus: float = 0.0
    slope: float = 0.0
    cost: float = 0.0
    target: float = 0.0
    tilt: float = 0.0
    luck: float = 0.0


def one_step(observation: np.ndarray | float = 0.0, **reward: float) -> Problem:
    """Every step is an episode."""
    seen = np.broadcast_to(np.float32(observation), (STEPS, RACES))
    return Problem(seen, seen[0], np.ones((STEPS, RACES), bool), **reward)


def live(model: ActorCritic, problem: Problem, key: jax.Array) -> Experience:
    """A rollout of the problem, as a collector would hand it over."""
    observation = problem.observation[:, None]
    mean = jnp.moveaxis(model.mean_action(jnp.moveaxis(observation, 1, 0)), 0, 1)
    action = mean + jnp.exp(model.log_std)[:, None] * jax.random.normal(key, mean.shape)
    miss = action - problem.target - problem.tilt * observation
    reward = problem.bonus + problem.slope * problem.observation - problem.cost * (miss**2).sum(1)
    density = jax.vmap(log_prob, in_axes=(0, None, 0))(mean, model.log_std, action)
    value = model.value(problem.observation[None])
    chance = jax.random.normal(jax.random.fold_in(key, 1), reward.shape)
    company = problem.observation > 0
    reward += problem.luck * jnp.where(company, chance, 0.0)
    ended = problem.terminated > 0
    transitions = Transitions(observation, action, jnp.ones_like(value), company, density, value, reward, ended)
    return Experience(transitions, model.value(problem.last_observation[None]), {})


@functools.cache
def learner(config: PPOConfig = CONFIG) -> Callable[[TrainState, Problem], TrainState]:
    """One update of a problem, compiled: one program serves them all."""
    learn = make_learn(config, make_optimiser(config, UPDATES), UPDATES)

    def update(state: TrainState, problem: Problem) -> TrainState:
        noise_key, shuffle_key = jax.random.split(jax.random.fold_in(state.key, state.updates))
        return learn(state, live(state.model, problem, noise_key), shuffle_key)[0]

    return jax.jit(update)


def beginner(seed: int = 0, updates: int = 0) -> TrainState:
    model = ActorCritic(NetworkShape(1, 2, CONFIG.hidden), -0.5, jax.random.key(seed))
    optimiser = make_optimiser(CONFIG, UPDATES).init(flatten(model))
    return TrainState(model, optimiser, None, None, None, None, jax.random.key(seed), jnp.asarray(updates, jnp.int32))


def learned(problem: Problem, config: PPOConfig = CONFIG) -> ActorCritic:
    """The model after a whole run."""
    state = beginner()
    problem = jax.tree.map(jnp.float32, problem)
    for _ in range(UPDATES):
        state = learner(config)(state, problem)
    return state.model


def values_at(model: ActorCritic, *observations: float) -> np.ndarray:
    return np.asarray(model.value(jnp.float32([observations])))


def actions_at(model: ActorCritic, *observations: float) -> np.ndarray:
    return np.asarray(model.mean_action(jnp.float32([observations])))


def coin(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).choice([-1.0, 1.0], size=(STEPS, RACES))


def test_a_constant_reward_is_its_own_value():
    assert values_at(learned(one_step(bonus=1.0)), 0.0) == pytest.approx(1.0, abs=0.02)


def test_value_depends_on_what_is_seen():
    model = learned(one_step(coin(0), bonus=0.5, slope=1.0))
    np.testing.assert_allclose(values_at(model, -1.0, 1.0), [-0.5, 1.5], atol=0.05)


@pytest.mark.parametrize("target", [0.6, -0.4])
def test_the_best_action_is_found_and_its_value_known(target):
    model = learned(one_step(cost=1.0, target=target))
    np.testing.assert_allclose(actions_at(model, 0.0), target, atol=0.05)
    std = np.exp(np.asarray(model.log_std))
    assert (std < 0.3).all()  # it began at 0.6; straying costs
    assert values_at(model, 0.0) == pytest.approx(-(std**2).sum(), abs=0.03)


def test_the_best_action_depends_on_what_is_seen():
    model = learned(one_step(coin(1), cost=1.0, target=0.1, tilt=0.5))
    np.testing.assert_allclose(actions_at(model, -1.0, 1.0), [[-0.4, 0.6]] * 2, atol=0.06)


def test_luck_in_company_does_not_drown_what_is_learned_alone():
    """Half of the steps are ruled by chance: standardised by it, the others teach next to nothing."""
    problem = one_step(coin(2), cost=1.0, target=0.6, luck=300.0)
    configs = (replace(CONFIG, company_distance=distance) for distance in (0.0, 5.0))
    together, apart = (actions_at(learned(problem, config), -1.0) for config in configs)
    np.testing.assert_allclose(apart, 0.6, atol=0.05)
    assert (abs(together - 0.6) > 0.2).all()


def test_a_later_reward_is_discounted():
    """Two steps, the reward at the second: worth gamma at the first. Half the races begin with the second."""
    second = (np.arange(STEPS)[:, None] + np.arange(RACES)) % 2
    problem = Problem(np.float32(second), np.float32(1 - second[-1]), second == 1, slope=1.0)
    np.testing.assert_allclose(values_at(learned(problem), 0.0, 1.0), [GAMMA, 1.0], atol=0.03)


def test_after_a_crash_comes_a_new_start():
    """The same, with the first step after the second: worth 1 + gamma^2 + gamma^4 and so on there."""
    second = (np.arange(STEPS)[:, None] + np.arange(RACES)) % 2
    problem = Problem(np.float32(second), np.float32(1 - second[-1]), second == 1, slope=1.0)
    worth = 1 / (1 - GAMMA**2)
    model = learned(problem, replace(CONFIG, after_crash="restart"))
    np.testing.assert_allclose(values_at(model, 0.0, 1.0), [GAMMA * worth, worth], atol=0.04)


def test_a_time_limit_is_not_a_failure():
    """One point a step for ever is worth 1 / (1 - gamma), though every rollout cuts it short."""
    problem = one_step(bonus=1.0)
    endless = problem._replace(terminated=np.zeros((STEPS, RACES), bool))
    assert values_at(learned(endless), 0.0) == pytest.approx(1 / (1 - GAMMA), abs=0.04)


def test_no_more_noise_than_allowed():
    """The entropy bonus alone would widen the policy for ever."""
    config = replace(CONFIG, entropy_weight=1.0, max_log_std=0.1, final_max_log_std=0.1)
    model = learned(one_step(bonus=1.0), config)
    np.testing.assert_allclose(model.log_std, 0.1, atol=1e-6)


def test_less_and_less_noise_is_allowed():
    config = replace(CONFIG, entropy_weight=1.0, entropy_hold=1.0, max_log_std=0.1, final_max_log_std=-2.0)
    model = learned(one_step(bonus=1.0), config)
    np.testing.assert_allclose(model.log_std, -2.0 + 2.1 / UPDATES, atol=1e-5)  # of the last update


def test_without_a_reason_exploration_is_kept():
    """A reward that depends on nothing moves neither the actions nor, by more than the entropy bonus, their spread."""
    model = learned(one_step(bonus=1.0))
    np.testing.assert_allclose(actions_at(model, 0.0), 0.0, atol=0.15)
    assert (np.asarray(model.log_std) > -0.6).all()


def test_the_entropy_bonus_is_held_then_fades():
    """Full weight up to a half of the run, none from four fifths on, a line between."""
    schedule = exploration_schedule(replace(CONFIG, entropy_weight=0.3, entropy_hold=0.5, entropy_end=0.8), 100)
    weights = [float(schedule(update)) for update in (0, 50, 65, 80, 99)]
    np.testing.assert_allclose(weights, [0.3, 0.3, 0.15, 0.0, 0.0], atol=1e-6)
    for step_down in (0.0, 1.0):  # no line at all
        sudden = exploration_schedule(replace(CONFIG, entropy_hold=step_down, entropy_end=step_down), 100)
        assert float(sudden(99)) == (0.0 if step_down == 0.0 else pytest.approx(CONFIG.entropy_weight))


def test_the_entropy_bonus_fades():
    """Where every advantage is 0 it acts alone: it widens the policy at the start of a run, not at its end."""
    flat = jax.tree.map(jnp.float32, one_step())
    early, late = beginner(), beginner(updates=UPDATES)
    assert (learner()(early, flat).model.log_std > early.model.log_std + 1e-3).all()
    np.testing.assert_allclose(learner()(late, flat).model.log_std, late.model.log_std, atol=1e-5)
    assert int(learner()(early, flat).updates) == 1
