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
    none, end = jnp.zeros((steps, races), bool), jnp.asarray(terminated, bool)
    transitions = Transitions(nothing, nothing, value, none, nothing[:, 0], value, reward, end)
    return Experience(transitions, last_value, {})


def random_rollout(seed: int, steps: int = 24, races: int = 7) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    reward, value = rng.normal(size=(2, steps, races))
    terminated = rng.random((steps, races)) < 0.15
    terminated[-1, :2] = True, False
    return reward, value, terminated, rng.normal(size=races)


def ppo(gamma: float, lam: float, after_crash="restart") -> PPOConfig:
    return PPOConfig(gamma=gamma, gae_lambda=lam, after_crash=after_crash)


@pytest.mark.parametrize("after_crash", ["restart", "nothing"])
@pytest.mark.parametrize(("gamma", "lam"), [(0.99, 0.95), (0.9, 0.0), (0.97, 1.0), (1.0, 1.0), (0.0, 0.9)])
def test_equals_the_recursion(gamma, lam, after_crash):
    config = ppo(gamma, lam, after_crash)
    for seed in range(3):
        reward, value, terminated, last = random_rollout(seed)
        found = advantages(experience_of(reward, value, terminated, last), config)
        for e in range(reward.shape[1]):
            row = reference.advantages(reward[:, e], value[:, e], terminated[:, e], last[e], config)
            np.testing.assert_allclose(found[:, e], row, atol=3e-5)


@pytest.mark.parametrize(("after_crash", "crashed"), [("restart", [-1.25, 3.0, 1.0]), ("nothing", [-2.0, 0.0, 1.0])])
def test_by_hand(after_crash, crashed):
    """gamma = lambda = 1/2, rewards 1 2 3, values 4 2 6, 8 beyond the end; race 1 crashes in step 1."""
    reward, value = np.tile([[1.0], [2.0], [3.0]], 2), np.tile([[4.0], [2.0], [6.0]], 2)
    terminated = np.array([[0, 0], [0, 1], [0, 0]])
    found = advantages(experience_of(reward, value, terminated, [8.0, 8.0]), ppo(0.5, 0.5, after_crash))
    # delta = 1+1-4, 2+3-2, 3+4-6 = -2, 3, 1;  A = 1, 3+1/4, -2+13/16
    # crashed: A_1 = delta_1 = 3, or without a future 2-2 = 0;  A_0 = -2 + A_1/4
    np.testing.assert_allclose(found[:, 0], [-1.1875, 3.25, 1.0], atol=1e-6)
    np.testing.assert_allclose(found[:, 1], crashed, atol=1e-6)


@pytest.mark.parametrize("after_crash", ["restart", "nothing"])
def test_what_happens_after_a_crash_is_not_its_doing(after_crash):
    """Its future is the value of a new start, or nothing; neither what is earned there, nor what it turns out to be."""
    reward, value, terminated, last = random_rollout(3)
    terminated[:] = False
    terminated[9] = True
    config = ppo(0.99, 0.95, after_crash)
    before = advantages(experience_of(reward, value, terminated, last), config)
    reward[10:], value[11:], last[:] = 1e3, -1e3, 1e3
    after = advantages(experience_of(reward, value, terminated, last), config)
    np.testing.assert_array_equal(before[:10], after[:10])
    start = 0.99 * value[10] if after_crash == "restart" else 0.0
    np.testing.assert_allclose(after[9], reward[9] + start - value[9], atol=1e-5)


def test_a_truncated_episode_has_one():
    """At the rollout's end, running or out of time, the last value stands for what would have come."""
    reward, value, terminated, last = random_rollout(4)
    terminated[-1] = False
    for after_crash in ("restart", "nothing"):
        found = advantages(experience_of(reward, value, terminated, last), ppo(0.9, 0.95, after_crash))
        np.testing.assert_allclose(found[-1], reward[-1] + 0.9 * last - value[-1], atol=1e-5)
    terminated[-1] = True
    found = advantages(experience_of(reward, value, terminated, last), ppo(0.9, 0.95, "nothing"))
    np.testing.assert_allclose(found[-1], reward[-1] - value[-1], atol=1e-5)


def test_the_value_target_is_advantage_plus_value():
    experience = experience_of(*random_rollout(5))
    config = PPOConfig(gamma=0.98, gae_lambda=0.9)
    batch = make_batch(experience, config)
    np.testing.assert_array_equal(batch.advantage, advantages(experience, config))
    np.testing.assert_allclose(batch.value_target, batch.advantage + experience.transitions.value, atol=1e-6)
