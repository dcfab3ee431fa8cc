"""Conservation laws and equilibria of the rigid body."""

from collections.abc import Iterator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Vehicle
from cruise.dynamics import RigidBody
from cruise.dynamics.rigid_body import Wrench, make_derivative
from tests.dynamics.bodies import UNEVEN, body, integrate, wrench
from tests.dynamics.paper_reference import body_to_world

J = np.array(UNEVEN.inertia)


@pytest.fixture(autouse=True)
def float64() -> Iterator[None]:
    with jax.enable_x64(True):
        yield


def rotational_energy(b: RigidBody) -> float:
    return float(0.5 * np.sum(J * np.asarray(b.angular_velocity_b) ** 2))


def angular_momentum_w(b: RigidBody) -> np.ndarray:
    return body_to_world(np.asarray(b.euler)) @ (J * np.asarray(b.angular_velocity_b))


def test_free_fall_is_a_parabola() -> None:
    start, t = body((1, 2, 50), (3, -1, 2), (0.3, -0.2, 1.0)), 1.7
    end = integrate(UNEVEN, "rk4", start, wrench(), t, 20)
    p, v = np.array([1, 2, 50.0]), np.array([3, -1, 2.0])
    down = np.array([0, 0, -UNEVEN.gravity])
    np.testing.assert_allclose(end.position_w, p + v * t + down * t**2 / 2, atol=1e-12)
    np.testing.assert_allclose(end.velocity_w, v + down * t, atol=1e-12)
    np.testing.assert_array_equal(end.euler, start.euler)


@pytest.mark.parametrize("kind", ["euler", "semi_implicit", "rk4"])
def test_hover_thrust_holds_a_level_body(kind: str) -> None:
    start = body((1, 2, 3), euler=(0, 0, 0.8))
    end = integrate(UNEVEN, kind, start, wrench(UNEVEN.mass * UNEVEN.gravity), 5.0, 50)
    np.testing.assert_allclose(np.concatenate(end), np.concatenate(start), atol=1e-13)


@pytest.mark.parametrize("rates", [(0.2, 0.1, 6.0), (6.0, 0.3, 0.1), (0.02, 6.0, 0.05)], ids=["z", "x", "y"])
def test_torque_free_rotation_conserves_energy_and_momentum(rates: tuple[float, float, float]) -> None:
    """About every principal axis; about the middle one the body tumbles, which the gyroscopic term alone drives."""
    start = body(euler=(0.1, 0.05, 0.3), rates=rates)
    end = integrate(UNEVEN, "rk4", start, wrench(), 2.0, 4000)
    assert np.abs(np.asarray(end.angular_velocity_b) - np.array(rates)).max() > 0.02
    assert rotational_energy(end) == pytest.approx(rotational_energy(start), rel=1e-9)
    spin = np.linalg.norm(J * np.asarray(end.angular_velocity_b))
    assert spin == pytest.approx(np.linalg.norm(J * np.array(rates)), rel=1e-9)


@pytest.mark.parametrize("rates", [(0.3, 0.2, 5.0), (-0.4, 0.5, -3.0)])
def test_torque_free_momentum_is_constant_in_the_world(rates: tuple[float, float, float]) -> None:
    start = body(euler=(0.2, -0.1, 0.5), rates=rates)
    for duration in (0.3, 0.9, 1.5):
        end = integrate(UNEVEN, "rk4", start, wrench(), duration, 1500)
        np.testing.assert_allclose(angular_momentum_w(end), angular_momentum_w(start), atol=1e-7)


def test_mechanical_energy_changes_by_the_work_of_thrust_alone() -> None:
    """d/dt (m v^2 / 2 + m g z) = T b_z . v along a flight; integrated by Simpson's rule over many instants."""
    push, start, steps = wrench(9.0, (2e-3, -1e-3, 1e-3)), body((0, 0, 5), (1, 2, 0), (0.1, 0.2, 0.3)), 40
    bodies = [start]
    for _ in range(steps):
        bodies.append(integrate(UNEVEN, "rk4", bodies[-1], push, 0.02, 1))
    energy = [
        0.5 * UNEVEN.mass * np.sum(np.asarray(b.velocity_w) ** 2) + UNEVEN.mass * UNEVEN.gravity * b.position_w[2]
        for b in (bodies[0], bodies[-1])
    ]
    power = [9.0 * body_to_world(np.asarray(b.euler))[:, 2] @ np.asarray(b.velocity_w) for b in bodies]
    weights = np.array([1, *([4, 2] * (steps // 2 - 1)), 4, 1]) * 0.02 / 3
    assert energy[1] - energy[0] == pytest.approx(weights @ np.array(power), abs=1e-5)


def test_the_gyroscopic_term_does_no_work() -> None:
    """omega . J d(omega)/dt is the power of the torque, whatever the motion."""
    rng = np.random.default_rng(1)
    rates, torque = rng.normal(0, 5, (3, 500)), rng.normal(0, 0.1, (3, 500))
    moving = body(np.zeros((3, 500)), np.zeros((3, 500)), rng.uniform(-1, 1, (3, 500)), rates)
    change = jax.jit(make_derivative(UNEVEN))(moving, Wrench(jnp.zeros(500), jnp.asarray(torque)))
    power = np.sum(rates * J[:, None] * np.asarray(change.angular_velocity_b), axis=0)
    np.testing.assert_allclose(power, np.sum(rates * torque, axis=0), atol=1e-12)


def test_mass_and_inertia_scale_the_response() -> None:
    start, push = body(euler=(0.2, 0.1, 0), rates=(0.5, -0.4, 0.3)), wrench(8.0, (0.01, 0.02, -0.01))
    heavy = replace(UNEVEN, mass=2 * UNEVEN.mass, inertia=tuple(2 * UNEVEN.inertia[i] for i in range(3)))
    doubled = wrench(16.0, (0.02, 0.04, -0.02))
    light_end = integrate(UNEVEN, "rk4", start, push, 0.5, 20)
    heavy_end = integrate(heavy, "rk4", start, doubled, 0.5, 20)
    np.testing.assert_allclose(np.concatenate(heavy_end), np.concatenate(light_end), atol=1e-12)


def test_a_symmetric_body_spins_freely_about_its_axis() -> None:
    """Jx = Jy: no torque arises from yaw, and the yaw rate stays."""
    vehicle = Vehicle()
    end = integrate(vehicle, "rk4", body(rates=(0, 0, 4.0)), wrench(), 1.3, 50)
    np.testing.assert_allclose(end.euler, [0, 0, 5.2], atol=1e-12)
    np.testing.assert_allclose(end.angular_velocity_b, [0, 0, 4.0], atol=1e-12)
