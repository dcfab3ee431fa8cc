"""Advantages against an independent recursion, and a case worked out by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import PPOConfig
from cruise.training.experience import Experience
from cruise.training.ppo import advantages, make_batch
from cruise.training.types import Transitions
from tests.training import reference


def experience_of(reward, value, terminated, last_value) -> Experience:
    """A rollout [T, E] in which only what GAE reads has a meaning."""
    reward, value, last_value = (jnp.asarray(x, jnp.float32) for x in (reward, value, last_value))
    steps, races = reward.shape
    nothing = jnp.zeros((steps, 1, races))
    transitions = Transitions(nothing, nothing, nothing[:, 0], value, reward, jnp.asarray(terminated, bool))
    return Experience(transitions, last_value, {})


def random_rollout(seed: int, steps: int = 24, races: int = 7) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    reward, value = rng.normal(size=(2, steps, races))
    terminated = rng.random((steps, races)) < 0.15
    terminated[-1, :2] = True, False
    return reward, value, terminated, rng.normal(size=races)


@pytest.mark.parametrize(("gamma", "lam"), [(0.99, 0.95), (0.9, 0.0), (0.97, 1.0), (1.0, 1.0), (0.0, 0.9)])
def test_equals_the_recursion(gamma, lam):
    for seed in range(3):
        reward, value, terminated, last = random_rollout(seed)
        found = advantages(experience_of(reward, value, terminated, last), gamma, lam)
        for e in range(reward.shape[1]):
            row = reference.advantages(reward[:, e], value[:, e], terminated[:, e], last[e], (gamma, lam))
            np.testing.assert_allclose(found[:, e], row, atol=3e-5)


def test_by_hand():
    """gamma = lambda = 1/2, rewards 1 2 3, values 4 2 6, 8 beyond the end; race 1 crashes in step 1."""
    reward, value = np.tile([[1.0], [2.0], [3.0]], 2), np.tile([[4.0], [2.0], [6.0]], 2)
    terminated = np.array([[0, 0], [0, 1], [0, 0]])
    found = advantages(experience_of(reward, value, terminated, [8.0, 8.0]), 0.5, 0.5)
    # delta = 1+1-4, 2+3-2, 3+4-6 = -2, 3, 1;  A = 1, 3+1/4, -2+13/16;  crashed: delta_1 = 2-2 = 0
    np.testing.assert_allclose(found[:, 0], [-1.1875, 3.25, 1.0], atol=1e-6)
    np.testing.assert_allclose(found[:, 1], [-2.0, 0.0, 1.0], atol=1e-6)


def test_a_crash_has_no_future():
    reward, value, terminated, last = random_rollout(3)
    terminated[:] = False
    terminated[9] = True
    before = advantages(experience_of(reward, value, terminated, last), 0.99, 0.95)
    reward[10:], value[10:], last[:] = 1e3, -1e3, 1e3
    after = advantages(experience_of(reward, value, terminated, last), 0.99, 0.95)
    np.testing.assert_array_equal(before[:10], after[:10])
    np.testing.assert_allclose(after[9], reward[9] - value[9], atol=1e-5)


def test_a_truncated_episode_has_one():
    """At the rollout's end, running or out of time, the last value stands for what would have come."""
    reward, value, terminated, last = random_rollout(4)
    terminated[-1] = False
    found = advantages(experience_of(reward, value, terminated, last), 0.9, 0.95)
    np.testing.assert_allclose(found[-1], reward[-1] + 0.9 * last - value[-1], atol=1e-5)
    terminated[-1] = True
    found = advantages(experience_of(reward, value, terminated, last), 0.9, 0.95)
    np.testing.assert_allclose(found[-1], reward[-1] - value[-1], atol=1e-5)


def test_the_value_target_is_advantage_plus_value():
    experience = experience_of(*random_rollout(5))
    config = PPOConfig(gamma=0.98, gae_lambda=0.9)
    batch = make_batch(experience, config)
    np.testing.assert_array_equal(batch.advantage, advantages(experience, 0.98, 0.9))
    np.testing.assert_allclose(batch.value_target, batch.advantage + experience.transitions.value, atol=1e-6)
