"""Vector arithmetic over a leading axis of components."""

import operator

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.vector import dot, fold, norm, once, sin_cos


@pytest.mark.parametrize("shape", [(3,), (3, 5), (3, 4, 5), (2, 7), (1, 3)])
def test_dot_and_norm_are_numpys(shape: tuple[int, ...]) -> None:
    a, b = np.random.default_rng(0).normal(size=(2, *shape)).astype(np.float32)
    x, y = jnp.asarray(a), jnp.asarray(b)
    np.testing.assert_allclose(dot(x, y), np.sum(a * b, axis=0), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(norm(x), np.linalg.norm(a, axis=0), rtol=1e-6)


def test_fold_runs_over_the_rows_in_order() -> None:
    rows = jnp.array([[9.0, 1.0], [2.0, 3.0], [4.0, 8.0]])
    np.testing.assert_array_equal(fold(operator.sub, rows), [3.0, -10.0])
    np.testing.assert_array_equal(fold(jnp.maximum, rows), [9.0, 8.0])


def test_sin_cos_against_numpy() -> None:
    """Within the promised 2e-7 for |angle| < 1000, densest where the quadrants meet."""
    rng = np.random.default_rng(1)
    borders = np.arange(-1273, 1274) * (np.pi / 4)
    near = (borders[:, None] + np.concatenate([[0.0], np.logspace(-7, -1, 20), -np.logspace(-7, -1, 20)])).ravel()
    angles = np.concatenate([rng.uniform(-1000, 1000, 100_000), rng.uniform(-4, 4, 100_000), near])
    angles = angles[np.abs(angles) < 1000].astype(np.float32)
    sine, cosine = (np.asarray(v, np.float64) for v in jax.jit(sin_cos)(angles))
    exact = angles.astype(np.float64)
    np.testing.assert_allclose(sine, np.sin(exact), rtol=0, atol=2e-7)
    np.testing.assert_allclose(cosine, np.cos(exact), rtol=0, atol=2e-7)
    np.testing.assert_allclose(sine**2 + cosine**2, 1, rtol=0, atol=4e-7)


def test_sin_cos_symmetries_are_exact() -> None:
    angles = jnp.asarray(np.random.default_rng(2).uniform(0, 50, 5000), jnp.float32)
    (sine, cosine), (minus_sine, minus_cosine) = sin_cos(angles), sin_cos(-angles)
    np.testing.assert_array_equal(minus_sine, -sine)
    np.testing.assert_array_equal(minus_cosine, cosine)
    assert [float(v) for v in sin_cos(jnp.float32(0.0))] == [0.0, 1.0]


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_once_changes_nothing(shape: tuple[int, ...]) -> None:
    flag = np.random.default_rng(3).random(shape) < 0.5
    for value in (flag, ~flag):
        result = once(jnp.asarray(value))
        assert result.dtype == bool
        np.testing.assert_array_equal(result, value)
