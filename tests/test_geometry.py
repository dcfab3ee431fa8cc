"""Frames and swept tests against dense sampling, alike in NumPy, JAX and CasADi, one by one and in batches."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise import geometry
from cruise.geometry import NEVER

casadi = pytest.importorskip("casadi")
ANGLE = st.floats(-math.pi, math.pi)
SAMPLES = np.linspace(0.0, 1.0, 4001)


def turn(axis: int, angle: float) -> np.ndarray:
    """Rotation about a world axis, by Rodrigues' formula."""
    cross = np.cross(np.eye(3)[axis], np.eye(3)).T
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


@given(ANGLE, ANGLE, ANGLE, st.lists(st.floats(-5, 5), min_size=3, max_size=3))
def test_a_gates_axes_are_the_columns_of_yaw_pitch_roll(yaw: float, pitch: float, roll: float, v: list) -> None:
    axes = turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)
    heading, tilt = geometry.heading_of(yaw), geometry.tilt_of(roll, pitch)
    np.testing.assert_allclose(geometry.to_gate(heading, v, tilt), axes.T @ v, atol=1e-12)
    np.testing.assert_allclose(geometry.from_gate(heading, v, tilt), axes @ v, atol=1e-12)
    np.testing.assert_allclose(geometry.to_body(axes, v), axes.T @ v, atol=1e-12)
    np.testing.assert_allclose(geometry.from_body(axes, v), axes @ v, atol=1e-12)


def random_flights(count: int = 400, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Start and end [3, count], some along an axis, some that stand still, some from within."""
    rng = np.random.default_rng(seed)
    start, end = rng.normal(size=(2, 3, count)) * rng.choice([0.3, 1.0, 3.0], count)
    kind = rng.integers(6, size=count)
    for axis in range(3):
        other = [a for a in range(3) if a != axis]
        end[np.ix_(other, kind == axis)] = start[np.ix_(other, kind == axis)]
    end[:, kind == 3] = start[:, kind == 3]
    return start, end


def in_cylinder(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.maximum(np.hypot(x, y) - 0.4, np.maximum(-z, z - 1.5))


def in_box(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.max([np.abs(x) - 0.5, np.abs(y) - 0.2, np.abs(z) - 0.8], axis=0)


def in_sphere(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.sqrt(x**2 + y**2 + z**2) - 0.7


SOLIDS = {
    "cylinder": (lambda a, b: geometry.meet_cylinder(a, b, 0.4, 1.5), in_cylinder),
    "box": (lambda a, b: geometry.meet_box(a, b, (0.5, 0.2, 0.8)), in_box),
    "sphere": (lambda a, b: geometry.meet_sphere(a, tuple(b[i] - a[i] for i in range(3)), 0.7), in_sphere),
    "ground": (lambda a, b: geometry.fall_below(a[2], b[2]), lambda x, y, z: z - 0 * x),
    "wall of a box": (lambda a, b: geometry.leave_above(a[0], b[0], 0.6), lambda x, y, z: 0.6 - x),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_first_contact_is_where_samples_first_lie_within(name: str) -> None:
    meet, depth = SOLIDS[name]
    start, end = random_flights()
    found = meet(tuple(start), tuple(end))
    points = start[..., None] + (end - start)[..., None] * SAMPLES
    outside = depth(*points)
    inside = outside <= 0
    if name in ("ground", "wall of a box"):  # noticed at the end of the step
        inside &= inside[:, -1:]
    met = inside.any(axis=1)
    clear = np.abs(outside.min(axis=1)) > 5e-3
    assert 20 < met.sum() < len(met) - 20
    np.testing.assert_array_equal((found <= 1)[clear], met[clear])
    first = SAMPLES[inside.argmax(axis=1)]
    slack = 2 / len(SAMPLES)
    both = clear & met & (found <= 1)
    if name in ("ground", "wall of a box"):
        first = np.where(inside[:, 0], 0.0, first)
    assert (np.abs(found - first) <= slack)[both].all()
    assert set(found[found > 1].tolist()) <= {NEVER}


@pytest.mark.parametrize("name", SOLIDS)
def test_numpy_jax_and_casadi_agree_alone_and_in_batches(name: str) -> None:
    meet, _ = SOLIDS[name]
    start, end = random_flights(60, seed=1)
    expected = meet(tuple(start), tuple(end))
    jitted = jax.jit(meet)
    batch = jitted(jnp.asarray(start, jnp.float32), jnp.asarray(end, jnp.float32))
    np.testing.assert_allclose(batch, expected, atol=2e-3)
    one = jitted(jnp.asarray(start[:, 7], jnp.float32), jnp.asarray(end[:, 7], jnp.float32))
    np.testing.assert_allclose(one, batch[7], atol=1e-6)
    a, b = casadi.SX.sym("a", 3), casadi.SX.sym("b", 3)
    traced = casadi.Function("meet", [a, b], [meet(a, b)])
    np.testing.assert_allclose([float(traced(*pair)) for pair in zip(start.T, end.T, strict=True)], expected, atol=1e-9)


def test_the_nearest_moment_is_that_of_samples() -> None:
    start, end = random_flights(300, seed=2)
    fraction = geometry.nearest_fraction(start, end - start)
    found = geometry.distance2_at(start, end - start, fraction)
    points = start[..., None] + (end - start)[..., None] * SAMPLES
    np.testing.assert_allclose(found, (points**2).sum(axis=0).min(axis=-1), atol=1e-5)
