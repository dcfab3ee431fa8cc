"""Fixed-step integrators of a rigid body, of either kind, whose wrench is held over the step."""

from collections.abc import Callable
from typing import Any

import jax

from cruise.config import Integrator
from cruise.dynamics.rigid_body import Derivative, Wrench
from cruise.vector import stored

Body = Any  # a RigidBody or a FreeBody
Integrate = Callable[[Body, Wrench], Body]


def _advance(body: Body, rate: Body, dt: float) -> Body:
    return jax.tree.map(lambda x, dx: x + dt * dx, body, rate)


def _euler_step(derivative: Derivative, dt: float) -> Integrate:
    """Explicit Euler, first order."""
    return lambda body, wrench: _advance(body, derivative(body, wrench), dt)


def _semi_implicit_step(derivative: Derivative, dt: float) -> Integrate:
    """Symplectic Euler, first order: velocities first, then poses with the new velocities."""

    def step(body: Body, wrench: Wrench) -> Body:
        moved = _advance(body, derivative(body, wrench), dt)
        new = {"velocity_w": moved.velocity_w, "angular_velocity_b": moved.angular_velocity_b}
        new = jax.tree.map(stored, new)
        faster = body._replace(**new)
        return _advance(faster, derivative(faster, wrench), dt)._replace(**new)

    return step


def _midpoint_step(derivative: Derivative, dt: float) -> Integrate:
    """Explicit midpoint rule, second order."""

    def step(body: Body, wrench: Wrench) -> Body:
        middle = jax.tree.map(stored, _advance(body, derivative(body, wrench), dt / 2))
        return _advance(body, derivative(middle, wrench), dt)

    return step


def _rk4_step(derivative: Derivative, dt: float) -> Integrate:
    """Classical Runge-Kutta, fourth order."""

    def step(body: Body, wrench: Wrench) -> Body:
        k1 = derivative(body, wrench)
        k2 = derivative(_advance(body, jax.tree.map(stored, k1), dt / 2), wrench)
        k3 = derivative(_advance(body, jax.tree.map(stored, k2), dt / 2), wrench)
        k4 = derivative(_advance(body, jax.tree.map(stored, k3), dt), wrench)
        mean = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, k1, k2, k3, k4)
        return _advance(body, mean, dt)

    return step


_STEPS = {"euler": _euler_step, "semi_implicit": _semi_implicit_step, "midpoint": _midpoint_step, "rk4": _rk4_step}


def make_integrator(kind: Integrator, derivative: Derivative, dt: float, substeps: int) -> Integrate:
    """A function that advances a body by `dt` [s] in `substeps` equal steps."""
    step = _STEPS[kind](derivative, dt / substeps)
    if substeps == 1:
        return step

    def integrate(body: Body, wrench: Wrench) -> Body:
        return jax.lax.fori_loop(0, substeps, lambda _, b: step(b, wrench), body, unroll=substeps <= 4)

    return integrate
