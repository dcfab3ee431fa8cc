"""The equations of PPO against slow loops and closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.training.formulas import clipped_surrogate, generalised_advantages


def sum_of_errors(reward, discount, decay, value) -> np.ndarray:
    """A_t as the sum over all later errors delta_k, each times the product of gamma lambda in between: no recursion."""
    steps = len(reward)
    delta = [reward[t] + discount[t] * value[t + 1] - value[t] for t in range(steps)]
    factors = [discount[t] * decay[t] for t in range(steps)]
    return np.array([sum(np.prod(factors[t:k]) * delta[k] for k in range(t, steps)) for t in range(steps)])


@pytest.mark.parametrize("seed", range(3))
def test_advantages_are_sums_of_later_errors(seed):
    rng = np.random.default_rng(seed)
    reward, discount, decay = rng.normal(size=(3, 17))
    discount, decay = np.clip(np.abs(discount), 0, 1), np.where(rng.random(17) < 0.2, 0.0, np.clip(np.abs(decay), 0, 1))
    value = rng.normal(size=18)
    found = generalised_advantages(*(jnp.asarray(x, jnp.float32) for x in (reward, discount, decay, value)))
    np.testing.assert_allclose(found, sum_of_errors(reward, discount, decay, value), atol=1e-5)


@pytest.mark.parametrize(("gamma", "lam"), [(0.9, 0.5), (0.99, 0.0), (0.5, 1.0)])
def test_constant_errors_make_a_geometric_series(gamma, lam):
    """With reward 1 and value 0 every error is 1: A_t = (1 - (gamma lambda)^(T-t)) / (1 - gamma lambda)."""
    steps, ones = 12, jnp.ones((12, 3))
    found = generalised_advantages(ones, gamma * ones, lam * ones, jnp.zeros((13, 3)))
    left, q = np.arange(steps, 0, -1), gamma * lam
    np.testing.assert_allclose(found, np.tile(((1 - q**left) / (1 - q))[:, None], 3), rtol=1e-6)


def test_a_true_value_function_leaves_no_advantage():
    """Where V is the discounted sum of what comes, there is nothing to gain, whatever lambda is."""
    rng = np.random.default_rng(0)
    reward, gamma = rng.normal(size=20), 0.95
    value = np.zeros(21)
    for t in reversed(range(20)):
        value[t] = reward[t] + gamma * value[t + 1]
    for lam in (0.0, 0.7, 1.0):
        rows = (reward, np.full(20, gamma), np.full(20, lam), value)
        found = generalised_advantages(*(jnp.asarray(x, jnp.float32) for x in rows))
        np.testing.assert_allclose(found, np.zeros(20), atol=1e-5)


def test_the_surrogate_is_the_lower_of_two():
    """Cases by hand: inside the clip, beyond it where it pays, beyond it where it costs."""
    ratio, advantage = jnp.float32([1.1, 1.5, 0.5, 1.5, 0.5]), jnp.float32([2.0, 2.0, 2.0, -2.0, -2.0])
    expected = [2.2, 2.4, 1.0, -3.0, -1.6]
    for r, a, wanted in zip(ratio, advantage, expected, strict=True):
        assert float(clipped_surrogate(r, a, 0.2)) == pytest.approx(-wanted)
    assert float(clipped_surrogate(ratio, advantage, 0.2).mean()) == pytest.approx(-np.mean(expected), rel=1e-5)


def test_the_surrogates_gradient_stops_at_the_clip_and_at_the_advantage():
    ratio, advantage = jnp.float32([1.1, 1.5, 0.5, 1.5, 0.5]), jnp.float32([2.0, 2.0, 2.0, -2.0, -2.0])
    by_ratio, by_advantage = jax.grad(lambda *of: clipped_surrogate(*of, 0.2).mean(), argnums=(0, 1))(ratio, advantage)
    np.testing.assert_allclose(by_ratio, -np.array([2.0, 0.0, 2.0, -2.0, 0.0]) / 5, rtol=1e-6)
    assert not np.asarray(by_advantage).any()


def test_what_is_not_finite_shows():
    """A diverged run must be seen: not a number is not dropped in favour of the clipped term."""
    assert np.isnan(clipped_surrogate(jnp.float32([np.nan, 1.0]), jnp.float32([1.0, 1.0]), 0.2)[0])
