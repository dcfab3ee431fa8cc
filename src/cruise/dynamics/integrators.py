"""Fixed-step integrators of a rigid body whose wrench is held over the step."""

from collections.abc import Callable

import jax

from cruise.config import Integrator
from cruise.dynamics.rigid_body import Derivative, Wrench
from cruise.dynamics.types import RigidBody

Integrate = Callable[[RigidBody, Wrench], RigidBody]


def _advance(body: RigidBody, rate: RigidBody, dt: float) -> RigidBody:
    return jax.tree.map(lambda x, dx: x + dt * dx, body, rate)


def _euler_step(derivative: Derivative, dt: float) -> Integrate:
    """Explicit Euler, first order."""
    return lambda body, wrench: _advance(body, derivative(body, wrench), dt)


def _semi_implicit_step(derivative: Derivative, dt: float) -> Integrate:
    """Symplectic Euler, first order: velocities first, then poses with the new velocities."""

    def step(body: RigidBody, wrench: Wrench) -> RigidBody:
        moved = _advance(body, derivative(body, wrench), dt)
        faster = body._replace(velocity_w=moved.velocity_w, angular_velocity_b=moved.angular_velocity_b)
        rate = derivative(faster, wrench)
        return faster._replace(
            position_w=body.position_w + dt * rate.position_w,
            euler=body.euler + dt * rate.euler,
        )

    return step


def _rk4_step(derivative: Derivative, dt: float) -> Integrate:
    """Classical Runge-Kutta, fourth order."""

    def step(body: RigidBody, wrench: Wrench) -> RigidBody:
        k1 = derivative(body, wrench)
        k2 = derivative(_advance(body, k1, dt / 2), wrench)
        k3 = derivative(_advance(body, k2, dt / 2), wrench)
        k4 = derivative(_advance(body, k3, dt), wrench)
        mean = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, k1, k2, k3, k4)
        return _advance(body, mean, dt)

    return step


_STEPS = {"euler": _euler_step, "semi_implicit": _semi_implicit_step, "rk4": _rk4_step}


def make_integrator(kind: Integrator, derivative: Derivative, dt: float, substeps: int) -> Integrate:
    """A function that advances a body by `dt` [s] in `substeps` equal steps."""
    step = _STEPS[kind](derivative, dt / substeps)
    if substeps == 1:
        return step

    def integrate(body: RigidBody, wrench: Wrench) -> RigidBody:
        return jax.lax.fori_loop(0, substeps, lambda _, b: step(b, wrench), body, unroll=substeps <= 4)

    return integrate
