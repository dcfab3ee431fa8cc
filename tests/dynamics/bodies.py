"""Rigid bodies, vehicles and flights for the tests of the dynamics."""

import functools
from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import Vehicle
from cruise.dynamics import DroneState, RigidBody, make_dynamics
from cruise.dynamics.integrators import make_integrator
from cruise.dynamics.rigid_body import Wrench, make_derivative

UNEVEN = replace(Vehicle(), name="uneven", mass=0.7, inertia=(0.005, 0.008, 0.011))


def body(position=(0, 0, 0), velocity=(0, 0, 0), euler=(0, 0, 0), rates=(0, 0, 0)) -> RigidBody:
    """A rigid body from four triples."""
    return RigidBody(*(jnp.asarray(np.asarray(v, float)) for v in (position, velocity, euler, rates)))


def wrench(thrust=0.0, torque=(0.0, 0.0, 0.0)) -> Wrench:
    """A thrust [N] and a body torque [N m]."""
    return Wrench(jnp.asarray(float(thrust)), jnp.asarray(np.asarray(torque, float)))


@functools.cache
def _stepper(vehicle: Vehicle, kind: str) -> Callable[..., RigidBody]:
    """Many steps of one integrator, compiled once for any step length and any number of steps.

    A step of length h of dx/dt = f is a step of length 1 of dx/dt = h f, so that h need not be a constant.
    """
    derivative = make_derivative(vehicle)

    def advance(start: RigidBody, push: Wrench, h: jax.Array, steps: jax.Array) -> RigidBody:
        step = make_integrator(kind, lambda b, w: jax.tree.map(lambda f: h * f, derivative(b, w)), 1.0, substeps=1)
        return jax.lax.fori_loop(0, steps, lambda _, b: step(b, push), start)

    return jax.jit(advance)


def integrate(vehicle: Vehicle, kind: str, start: RigidBody, push: Wrench, duration: float, steps: int) -> RigidBody:
    """The body after `duration` [s] in `steps` steps of one integrator under a constant wrench."""
    return _stepper(vehicle, kind)(start, push, duration / steps, steps)


def fly(vehicle: Vehicle, start: DroneState, actions: jax.Array, agility: float) -> DroneState:
    """Every state of a flight under `actions` [T, 3, *B]: leaves [T, 3, *B]."""
    dynamics = make_dynamics(vehicle)
    alpha = jnp.asarray(agility, actions.dtype)

    def advance(state: DroneState, action: jax.Array) -> tuple[DroneState, DroneState]:
        state = dynamics.step(state, action, alpha)
        return state, state

    return jax.jit(lambda s, a: jax.lax.scan(advance, s, a)[1])(start, actions)


def at_rest(vehicle: Vehicle, position_w: np.ndarray) -> DroneState:
    """A drone at rest at `position_w` [3, *B]."""
    position = jnp.asarray(position_w)
    return make_dynamics(vehicle).init(position, jnp.zeros(position.shape[1:], position.dtype))


def smooth_actions(rng: np.random.Generator, steps: int, drones: int, dt: float = 0.1) -> np.ndarray:
    """Sums of three sine waves within [-1, 1], [T, 3, drones]."""
    t = dt * np.arange(steps)[:, None, None, None]
    frequency = rng.uniform(0.1, 0.6, (3, 3, drones))
    phase = rng.uniform(0, 2 * np.pi, (3, 3, drones))
    return np.sin(2 * np.pi * frequency * t + phase).mean(axis=1)


def chattering_actions(rng: np.random.Generator, steps: int, drones: int) -> np.ndarray:
    """Full deflection of random sign on every axis in every step, beyond the clip now and then."""
    return rng.choice([-1.5, -1.0, 1.0, 1.5], (steps, 3, drones))
