"""Quaternions against scipy's rotations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cruise.dynamics import quaternion
from tests.dynamics.quadrotors import random_attitudes

ATTITUDES = random_attitudes(500)
ROTATIONS = Rotation.from_quat(ATTITUDES.T, scalar_first=True)


def test_rotation_matrix_and_thrust_axis() -> None:
    matrix = np.asarray(quaternion.rotation_matrix(jnp.asarray(ATTITUDES)))
    np.testing.assert_allclose(matrix.transpose(2, 0, 1), ROTATIONS.as_matrix(), atol=1e-6)
    axis = np.stack(quaternion.thrust_axis_w(jnp.asarray(ATTITUDES)))
    np.testing.assert_allclose(axis, ROTATIONS.as_matrix()[:, :, 2].T, atol=1e-6)


def test_derivative_is_that_of_a_turn_about_the_bodys_axes() -> None:
    """Central difference of R exp(omega h)."""
    rates, h = np.random.default_rng(1).uniform(-5, 5, (3, 500)), 1e-6
    after, before = (
        (ROTATIONS * Rotation.from_rotvec(sign * h * rates.T)).as_quat(scalar_first=True).T for sign in (1, -1)
    )
    after, before = (x * np.sign((x * ATTITUDES).sum(axis=0)) for x in (after, before))  # q and -q are one attitude
    with jax.enable_x64(True):
        change = np.stack(quaternion.derivative(jnp.asarray(ATTITUDES), jnp.asarray(rates)))
    np.testing.assert_allclose(change, (after - before) / (2 * h), atol=1e-7)


def test_normalise_keeps_the_direction() -> None:
    long = ATTITUDES * np.random.default_rng(2).uniform(0.5, 2.0, 500)
    np.testing.assert_allclose(np.stack(quaternion.normalise(jnp.asarray(long))), ATTITUDES, atol=1e-6)


def test_euler_angles_are_scipys() -> None:
    with jax.enable_x64(True):
        euler = np.asarray(quaternion.to_euler(jnp.asarray(ATTITUDES)))
    np.testing.assert_allclose(euler, ROTATIONS.as_euler("ZYX")[:, ::-1].T, atol=1e-9)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_euler_angles_of_a_drone_that_stands_on_end(pitch: float) -> None:
    """Roll and yaw are one turn there; what comes back is the same attitude all the same."""
    turns = np.random.default_rng(3).uniform(-3, 3, (50, 2))
    upright = Rotation.from_euler("ZYX", [[yaw, pitch, roll] for yaw, roll in turns])
    euler = np.asarray(quaternion.to_euler(jnp.asarray(upright.as_quat(scalar_first=True).T)))
    back = Rotation.from_euler("ZYX", euler[::-1].T)
    assert (back * upright.inv()).magnitude().max() < 2e-3  # float32: the arcsine of 1 is known to 3e-4


def test_from_heading_is_level() -> None:
    yaw = np.linspace(-7, 7, 29)
    q = np.asarray(quaternion.from_heading(jnp.asarray(yaw)))
    expected = Rotation.from_euler("Z", yaw[:, None]).as_matrix()
    np.testing.assert_allclose(Rotation.from_quat(q.T, scalar_first=True).as_matrix(), expected, atol=1e-6)
