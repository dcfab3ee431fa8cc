"""Attitude: the rotation and the rates behind ZYX Euler angles, against scipy; thrust and its bound."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cruise.dynamics import RigidBody
from cruise.dynamics.cascade import commanded_acceleration, velocity_error, wrench_from_acceleration
from cruise.dynamics.rigid_body import euler_rates, thrust_axis_w
from cruise.presets import VEHICLES

VEHICLE = VEHICLES["paper"]


def random_attitudes(count: int) -> np.ndarray:
    """Roll and yaw anywhere, pitch up to 80 degrees: [3, count], exact in float32."""
    limits = np.array([[np.pi], [1.4], [2 * np.pi]])
    return (np.random.default_rng(3).uniform(-1, 1, (3, count)) * limits).astype(np.float32)


def rotations(euler: np.ndarray) -> Rotation:
    return Rotation.from_euler("ZYX", euler[::-1].T.astype(np.float64))


def test_thrust_axis_is_the_third_column_of_the_rotation() -> None:
    euler = random_attitudes(2000)
    np.testing.assert_allclose(jax.jit(thrust_axis_w)(euler), rotations(euler).as_matrix()[:, :, 2].T, atol=1e-6)


def test_thrust_axis_signs() -> None:
    """Positive pitch leans towards +x, positive roll towards -y; yaw alone leaves it vertical."""
    roll, pitch, yaw = (jnp.eye(3) * 0.1)[:, :, None]
    assert thrust_axis_w(pitch)[0, 0] > 0.09
    assert thrust_axis_w(roll)[1, 0] < -0.09
    np.testing.assert_allclose(thrust_axis_w(yaw)[:, 0], [0, 0, 1], atol=1e-7)


def test_euler_rates_are_the_derivative_of_the_rotation() -> None:
    """Central difference of R exp(omega h), read back as Euler angles by scipy."""
    euler = random_attitudes(500)
    omega = np.random.default_rng(4).uniform(-3, 3, euler.shape).astype(np.float32)
    here, h = rotations(euler), 1e-5
    after, before = (here * Rotation.from_rotvec(s * h * omega.T.astype(np.float64)) for s in (1, -1))
    change = (after.as_euler("ZYX") - before.as_euler("ZYX"))[:, ::-1].T
    change = (change + np.pi) % (2 * np.pi) - np.pi  # a turn through +-pi is no jump
    np.testing.assert_allclose(jax.jit(euler_rates)(euler, omega), change / (2 * h), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2, np.float32(np.pi / 2)])
def test_euler_rates_stay_finite_at_the_singularity(pitch: float) -> None:
    euler = jnp.array([0.3, pitch, 0.1], jnp.float32)
    assert np.isfinite(np.asarray(euler_rates(euler, jnp.array([1.0, 2.0, -3.0])))).all()


def test_thrust_is_never_negative_and_otherwise_as_printed() -> None:
    rng = np.random.default_rng(5)
    command = jnp.asarray(rng.uniform(-40, 40, (3, 5000)), jnp.float32)
    zero = jnp.zeros_like(command)
    thrust = np.asarray(wrench_from_acceleration(VEHICLE, command, RigidBody(zero, zero, zero, zero)).collective_thrust)
    printed = VEHICLE.mass * VEHICLE.gravity + VEHICLE.mass * np.asarray(command[2])
    assert (thrust >= 0).all()
    assert (thrust == 0).any()
    np.testing.assert_allclose(thrust[printed > 0], printed[printed > 0], rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(thrust[printed <= 0], 0)


def test_torque_vanishes_at_the_desired_attitude_and_restores_beside_it() -> None:
    command, zero = jnp.array([2.0, -1.0, 0.5]), jnp.zeros(3)
    desired = jnp.array([1.0, 2.0, 0.0]) / VEHICLE.gravity
    at = RigidBody(zero, zero, desired, zero)
    np.testing.assert_allclose(wrench_from_acceleration(VEHICLE, command, at).body_torque_b, 0, atol=1e-8)
    for axis in range(3):
        lean = jnp.eye(3)[axis] * 0.2
        torque = np.asarray(wrench_from_acceleration(VEHICLE, command, at._replace(euler=desired + lean)).body_torque_b)
        assert torque[axis] == pytest.approx(-0.1 * 0.2, abs=1e-7)
        spinning = wrench_from_acceleration(VEHICLE, command, at._replace(angular_velocity_b=lean))
        assert np.asarray(spinning.body_torque_b)[axis] == pytest.approx(-0.05 * 0.2, abs=1e-7)


def test_actions_beyond_one_count_as_one() -> None:
    wild = jnp.array([7.0, -1.5, 0.25])
    np.testing.assert_allclose(velocity_error(wild, jnp.float32(6.0), 0.1), [0.6, -0.6, 0.15], rtol=1e-6)


def test_the_difference_term_is_not_divided_by_dt() -> None:
    now, before, velocity = jnp.array([[0.5, 0, 0], [0.2, 0, 0], [0, 0, 2.0]])
    command = commanded_acceleration(VEHICLE, now, before, velocity)
    np.testing.assert_allclose(command, [5 * (0.42 * 0.5 + 2.0 * 0.3), 0, -0.1], rtol=1e-6)
