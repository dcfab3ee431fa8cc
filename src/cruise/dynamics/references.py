"""What an action means: the vehicle's own command, or a reference that its loops follow."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Tracking, Vehicle
from cruise.dynamics.tracking import demanded_acceleration, demanded_velocity
from cruise.dynamics.types import DroneState, Dynamics, Reference


def reference_of(
    vehicle: Vehicle, state: DroneState, action: Float[Array, "3 *B"], agility: Array | float
) -> Reference:
    """The reference that an action in [-1, 1]^3 stands for, in the world's frame.

    `acceleration`: agility x action [m/s^2]. `velocity`: `tracking.speed` x action [m/s]. `position`: a point
    `tracking.reach` x action [m] from the drone.
    """
    action = jnp.clip(action, -1.0, 1.0)
    if vehicle.control == "acceleration":
        return Reference(acceleration_w=agility * action)
    if vehicle.control == "velocity":
        return Reference(velocity_w=vehicle.tracking.speed * action)
    return Reference(position_w=state.position_w + vehicle.tracking.reach * action)


def action_of(
    vehicle: Vehicle, state: DroneState, reference: Reference, agility: Array | float
) -> Float[Array, "3 *B"]:
    """The action whose reference has the vehicle follow another one: the loops outside of it are run through here."""
    tracking = vehicle.tracking
    if vehicle.control == "acceleration":
        wanted = demanded_acceleration(tracking, state, reference, agility)
    elif vehicle.control == "velocity":
        wanted = _velocity(tracking, state, reference) / tracking.speed
    else:
        wanted = _velocity(tracking, state, reference) / (tracking.position_gain * tracking.reach)
    return jnp.clip(wanted, -1.0, 1.0)


def _velocity(tracking: Tracking, state: DroneState, reference: Reference) -> Float[Array, "3 *B"]:
    """The velocity of which the velocity loop makes the acceleration that is wanted [m/s]."""
    wanted = demanded_velocity(tracking, state, reference)
    wanted = state.velocity_w if wanted is None else wanted
    gain = reference.velocity_gain or tracking.velocity_gain
    return wanted if reference.acceleration_w is None else wanted + reference.acceleration_w / gain


def with_control(vehicle: Vehicle, dynamics: Dynamics) -> Dynamics:
    """The vehicle flown by what `vehicle.control` says, through its own `track` where that is a reference."""
    if vehicle.told_directly:
        return dynamics

    def step(
        state: DroneState, action: Float[Array, "3 *B"], agility: Array | float, air_w: Array | None = None
    ) -> DroneState:
        reference = reference_of(vehicle, state, action, agility)
        return dynamics.step(state, dynamics.track(state, reference, agility), agility, air_w)

    def track(state: DroneState, reference: Reference, agility: Array | float) -> Float[Array, "3 *B"]:
        return action_of(vehicle, state, reference, agility)

    return dynamics._replace(action=vehicle.action, step=step, track=track)
