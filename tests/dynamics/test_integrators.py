"""Order of convergence, sub-steps, and what each integrator must keep."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.dynamics import FreeBody
from cruise.dynamics.integrators import make_integrator
from cruise.dynamics.parameters import physics_of
from cruise.dynamics.rigid_body import make_derivative, make_free_derivative
from cruise.presets import VEHICLES
from tests.dynamics.bodies import UNEVEN, at_rest, body, chattering_actions, fly, integrate, smooth_actions, wrench
from tests.dynamics.quadrotors import BARE, with_drag

DURATION = 0.4
START = ((1, 2, 3), (1, -2, 0.5), (0.1, -0.2, 0.3), (1.0, -0.8, 0.6))


@pytest.fixture(autouse=True)
def float64() -> Iterator[None]:
    with jax.enable_x64(True):
        yield


def end_of_flight(kind: str, steps: int) -> np.ndarray:
    """Final state of a curved flight with every term at work; angles stay below 45 degrees."""
    end = integrate(UNEVEN, kind, body(*START), wrench(8.0, (-6e-3, 8e-3, 4e-3)), DURATION, steps)
    return np.concatenate([np.asarray(part) for part in end])


@pytest.mark.parametrize(("kind", "order"), [("euler", 1), ("semi_implicit", 1), ("midpoint", 2), ("rk4", 4)])
def test_order_of_convergence(kind: str, order: int) -> None:
    exact = end_of_flight("rk4", 2000)
    assert np.abs(exact[6:9]).max() < np.pi / 4
    assert np.abs(exact[:3] - np.array(START[0])).max() > 0.3
    steps = np.array([5, 10, 20, 40] if order == 4 else [20, 40, 80, 160])
    errors = [np.linalg.norm(end_of_flight(kind, int(n)) - exact) for n in steps]
    slope = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize(("kind", "bias"), [("euler", -1), ("semi_implicit", 1), ("rk4", 0)])
@pytest.mark.parametrize("steps", [1, 5, 40])
def test_free_fall_keeps_gravity(kind: str, bias: int, steps: int) -> None:
    """All keep dv = g t exactly; the fallen height is g t^2 / 2 (1 + bias / steps), the textbook O(h) error."""
    t, g = 1.2, UNEVEN.gravity
    end = integrate(UNEVEN, kind, body((0, 0, 20), (1, 0, 0)), wrench(), t, steps)
    np.testing.assert_allclose(end.velocity_w, [1, 0, -g * t], atol=1e-12)
    np.testing.assert_allclose(end.position_w, [t, 0, 20 - g * t**2 / 2 * (1 + bias / steps)], atol=1e-12)


def test_integrators_agree_in_the_limit() -> None:
    exact = end_of_flight("rk4", 2000)
    for kind in ("euler", "semi_implicit"):
        np.testing.assert_allclose(end_of_flight(kind, 20000), exact, atol=2e-4)


@pytest.mark.parametrize("kind", ["euler", "semi_implicit", "rk4"])
@pytest.mark.parametrize("substeps", [3, 7])
def test_substeps_are_steps(kind: str, substeps: int) -> None:
    """n sub-steps of one call are n steps, unrolled or not."""
    start, push = body(*START), wrench(8.0, (-6e-3, 8e-3, 4e-3))
    at_once = make_integrator(kind, make_derivative(UNEVEN), DURATION, substeps)
    expected = integrate(UNEVEN, kind, start, push, DURATION, substeps)
    np.testing.assert_allclose(np.concatenate(jax.jit(at_once)(start, push)), np.concatenate(expected), atol=1e-13)


def test_ten_rk4_substeps_have_converged() -> None:
    """The whole vehicle over 5 s: the wrench is held over 0.1 s, so only the body's motion is left to converge."""
    rng = np.random.default_rng(2)
    actions = jnp.asarray(np.concatenate([smooth_actions(rng, 50, 3), chattering_actions(rng, 50, 3)], axis=2))
    start = np.array([[0.0], [0.0], [30.0]]) + rng.uniform(-1, 1, (3, 6))

    def flown(substeps: int) -> np.ndarray:
        vehicle = replace(VEHICLES["paper"], integrator="rk4", substeps=substeps)
        return np.concatenate(fly(vehicle, at_rest(vehicle, start), actions, 7.5).body, axis=1)

    converged = flown(200)
    assert np.abs(converged[:, 6:9]).max() > 0.2
    np.testing.assert_allclose(flown(10), converged, atol=1e-4)


FREE_START = ((1.0, 2.0, 3.0), (1.0, -2.0, 0.5), (0.9, 0.2, -0.3, 0.25), (3.0, -2.0, 1.5))


def end_of_free_flight(kind: str, steps: int) -> np.ndarray:
    """The same for a body whose attitude is a quaternion, with drag, thrust and torque at work."""
    physics = physics_of(with_drag(BARE, horizontal=0.5, vertical=0.8, quadratic=0.05))
    derivative = make_free_derivative(physics, BARE.gravity, (0.5, -1.0, 0.2))
    position, velocity, attitude, rates = (jnp.asarray(x) for x in FREE_START)
    start = FreeBody(position, velocity, attitude / jnp.linalg.norm(attitude), rates)
    push = wrench(8.0, (-6e-3, 8e-3, 4e-3))

    def together(body: FreeBody) -> FreeBody:
        return FreeBody(*(jnp.stack(list(part)) for part in body))

    def advance(h: jax.Array, n: jax.Array) -> FreeBody:
        def scaled(body: FreeBody, exerted: object) -> FreeBody:  # see `bodies.integrate`
            return jax.tree.map(lambda f: h * f, together(derivative(body, exerted)))

        step = make_integrator(kind, scaled, 1.0, substeps=1)
        return jax.lax.fori_loop(0, n, lambda _, body: step(body, push), start)

    return np.concatenate([np.asarray(part) for part in _free(kind, advance)(DURATION / steps, steps)])


_FREE: dict[str, Callable] = {}


def _free(kind: str, advance: Callable) -> Callable:
    return _FREE.setdefault(kind, jax.jit(advance))


@pytest.mark.parametrize(("kind", "order"), [("euler", 1), ("semi_implicit", 1), ("midpoint", 2), ("rk4", 4)])
def test_order_of_convergence_with_a_quaternion(kind: str, order: int) -> None:
    exact = end_of_free_flight("rk4", 2000)
    steps = np.array([5, 10, 20, 40] if order == 4 else [20, 40, 80, 160])
    errors = [np.linalg.norm(end_of_free_flight(kind, int(n)) - exact) for n in steps]
    slope = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.15)
