"""Quadrotors with terms switched on and off, and flights of them, for the tests of the dynamics."""

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import Airframe, Drag, Rates, Rotors, Vehicle
from cruise.dynamics import DroneState, Dynamics, FreeBody, make_dynamics
from cruise.vehicles import VEHICLES

RACER = VEHICLES["racer"]

# Nothing but a rate loop without limits: inertia uneven, so that every term of Euler's equation is at work.
BARE = replace(
    RACER,
    name="bare",
    inertia=(0.0025, 0.004, 0.0043),
    airframe=Airframe(
        rotors=Rotors(offset=(0.075, 0.1), torque_ratio=0.022, max_thrust=6.0, saturate=False),
        rates=Rates(time_constant=0.04),
    ),
)


def with_rotors(vehicle: Vehicle, **changes: Any) -> Vehicle:
    """The vehicle with other rotors."""
    airframe = vehicle.airframe
    assert airframe is not None
    return replace(vehicle, airframe=replace(airframe, rotors=replace(airframe.rotors, **changes)))


def with_airframe(vehicle: Vehicle, **changes: Any) -> Vehicle:
    """The vehicle with another airframe."""
    assert vehicle.airframe is not None
    return replace(vehicle, airframe=replace(vehicle.airframe, **changes))


def with_drag(vehicle: Vehicle, **terms: float) -> Vehicle:
    """The vehicle with this drag and no other."""
    return with_airframe(vehicle, drag=Drag(**terms))


@functools.cache
def dynamics_of(vehicle: Vehicle) -> Dynamics:
    """Its functions, made once."""
    return make_dynamics(vehicle)


@functools.cache
def _flyer(vehicle: Vehicle) -> Callable[..., tuple[DroneState, DroneState]]:
    dynamics = dynamics_of(vehicle)

    def advance(state: DroneState, action: jax.Array) -> tuple[DroneState, DroneState]:
        state = dynamics.step(state, action, jnp.asarray(vehicle.agility, action.dtype))
        return state, state

    return jax.jit(lambda state, actions: jax.lax.scan(advance, state, actions))


def fly_as_given(vehicle: Vehicle, start: DroneState, actions: np.ndarray) -> DroneState:
    """Every state of a flight under `actions` [T, A, *B]: leaves [T, ..., *B]."""
    return _flyer(vehicle)(start, jnp.asarray(actions))[1]


CHUNK, COLUMNS = 10, 10


def fly(vehicle: Vehicle, start: DroneState, actions: np.ndarray) -> DroneState:
    """The same for one drone or up to ten, compiled once per vehicle: ten steps at a time, ten drones side by side."""
    steps, batch = len(actions), actions.shape[2:]
    drones = batch[0] if batch else 1

    def wide(x: np.ndarray) -> jax.Array:
        columns = jnp.asarray(x).reshape(*x.shape[: x.ndim - len(batch)], drones)
        return jnp.concatenate([columns] + [columns[..., -1:]] * (COLUMNS - drones), axis=-1)

    state, padded = jax.tree.map(wide, start), wide(actions)
    padded = jnp.concatenate([padded] + [padded[-1:]] * (-steps % CHUNK))
    parts = []
    for first in range(0, steps, CHUNK):
        state, part = _flyer(vehicle)(state, padded[first : first + CHUNK])
        parts.append(part)
    joined = jax.tree.map(lambda *pieces: np.concatenate(pieces)[:steps, ..., :drones], *parts)
    return joined if batch else jax.tree.map(lambda x: x[..., 0], joined)


def state_of(
    vehicle: Vehicle,
    attitude: np.ndarray | tuple = (1.0, 0.0, 0.0, 0.0),
    rates: np.ndarray | tuple = (0.0, 0.0, 0.0),
    velocity: np.ndarray | tuple = (0.0, 0.0, 0.0),
    position: np.ndarray | tuple = (0.0, 0.0, 100.0),
    thrust: float | None = None,
) -> DroneState:
    """A drone in any motion, its rotors giving `thrust` [N], or what hovering needs."""
    parts = [np.asarray(x, float) for x in (position, velocity, attitude, rates)]
    batch = np.broadcast_shapes(*(x.shape[1:] for x in parts))
    full = [np.broadcast_to(x.reshape(len(x), *x.shape[1:] or (1,) * len(batch)), (len(x), *batch)) for x in parts]
    position, velocity, attitude, rates = (jnp.asarray(x) for x in full)
    state = dynamics_of(vehicle).init(position, jnp.zeros(batch, position.dtype))
    state = state._replace(body=FreeBody(position, velocity, attitude, rates))
    if thrust is not None:
        state = state._replace(memory=state.memory._replace(wrench=state.memory.wrench.at[0].set(thrust)))
    return state


def random_attitudes(count: int, seed: int = 0) -> np.ndarray:
    """Unit quaternions [4, count], uniform over all attitudes."""
    q = np.random.default_rng(seed).normal(size=(4, count))
    return q / np.linalg.norm(q, axis=0)


def action_for(vehicle: Vehicle, thrust: float, rates: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """The action that asks for a collective thrust [N] and body rates [rad/s]."""
    assert vehicle.airframe is not None
    share = [rate / highest for rate, highest in zip(rates, vehicle.airframe.rates.highest, strict=True)]
    return np.array([2 * thrust / vehicle.mass / vehicle.agility - 1, *share])


def smooth_actions(steps: int, drones: int, seed: int = 0, size: int = 4) -> np.ndarray:
    """Sums of sines within [-1, 1], [T, A, drones], different for every drone and number."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, steps)[:, None, None, None]
    frequency, phase = rng.uniform(0.5, 4.0, (3, size, drones)), rng.uniform(0, 2 * np.pi, (3, size, drones))
    return np.sin(2 * np.pi * frequency * t + phase).mean(axis=1)
