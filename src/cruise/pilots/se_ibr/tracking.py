"""From a plan to an action: one small function for each vehicle. The plan itself knows no vehicle."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from cruise.config import Vehicle
from cruise.dynamics import DroneState, Dynamics, RigidBody
from cruise.pilots.se_ibr.options import Limit
from cruise.pilots.se_ibr.trajectory import Trajectory


class Moment(NamedTuple):
    """What a tracker knows beside the trajectory."""

    drones: DroneState
    age: Array | float  # since the plan was made [s]
    lead: Array | float  # the wanted acceleration reaches the plan's velocity so much later [s]
    agility: float  # scale of the action


class Tracker(NamedTuple):
    """How plans are flown with a vehicle.

    `ahead` is where the drones will be, whatever is commanded, when a command given now begins to act: position [m] and
    velocity [m/s]. Plans begin there. `command` is the action that follows a trajectory which begins there. `limit`
    says whether the vehicle's acceleration is limited as a whole or on every axis of the world by itself.
    """

    ahead: Callable[[DroneState], tuple[Array, Array]]
    command: Callable[[Trajectory, Moment], Array]
    limit: Limit


def cascade_tracker(vehicle: Vehicle) -> Tracker:
    """The paper's cascade, inverted.

    A tilt follows the command as a second-order system; under the cascade's explicit Euler steps of h, with a the
    acceleration of the tilt and b its rate,

        a(t+1) = a(t) + h b(t),  b(t+1) = (1 - h d) b(t) + h k (command(t) - a(t)),

    so that a command first moves a(t+2), and that acceleration can be chosen.
    """
    h, g, gains = vehicle.control_dt, vehicle.gravity, vehicle.controller
    k, d = gains.attitude_p / vehicle.inertia[0], gains.attitude_d / vehicle.inertia[0]

    def tilt(drones: DroneState) -> tuple[Array, Array, Array]:
        """Horizontal accelerations a(t), a(t+1) and the rate b(t+1) under no command [m/s^2, m/s^3]."""
        assert isinstance(drones.body, RigidBody)
        roll, pitch, _ = drones.body.euler
        p, q, _ = drones.angular_velocity_b
        now, rate = g * jnp.stack([pitch, -roll]), g * jnp.stack([q, -p])
        return now, now + h * rate, (1 - h * d) * rate - h * k * now

    def ahead(drones: DroneState) -> tuple[Array, Array]:
        now, next_, _ = tilt(drones)
        still = jnp.zeros_like(now[:1])
        now, next_ = jnp.concatenate([now, still]), jnp.concatenate([next_, still])
        velocity = drones.velocity_w
        return drones.position_w + 2 * h * velocity + h * h * now, velocity + h * (now + next_)

    def command(trajectory: Trajectory, moment: Moment) -> Array:
        _, velocity = ahead(moment.drones)
        wanted = (trajectory.velocity_at(moment.age + moment.lead) - velocity) / moment.lead
        _, next_, rate = tilt(moment.drones)
        level = ((wanted[:2] - next_) / h - rate) / (h * k)
        assert isinstance(moment.drones.body, RigidBody)
        roll, pitch, _ = moment.drones.body.euler
        up = (g + wanted[2]) / (jnp.cos(roll) * jnp.cos(pitch)) - g
        acceleration = jnp.concatenate([level, up[None]])
        return _action(acceleration, moment)

    def _action(acceleration: Array, moment: Moment) -> Array:
        """The velocity error e whose PD law gives an acceleration (`cruise.dynamics.cascade`), over its scale."""
        damped = acceleration + gains.position_d * moment.drones.velocity_w
        kept = gains.position_p * gains.velocity_d * moment.drones.memory
        error = (damped + kept) / (gains.position_p * (gains.velocity_p + gains.velocity_d))
        return jnp.clip(error / (moment.agility * h), -1.0, 1.0)

    return Tracker(ahead, command, limit="box")


def reference_tracker(dynamics: Dynamics) -> Tracker:
    """A vehicle that follows position, velocity and acceleration by itself, and acts at once."""

    def ahead(drones: DroneState) -> tuple[Array, Array]:
        return drones.position_w, drones.velocity_w

    def command(trajectory: Trajectory, moment: Moment) -> Array:
        return dynamics.track(moment.drones, trajectory.at(moment.age), moment.agility)

    return Tracker(ahead, command, limit="ball")


def tracker_of(vehicle: Vehicle, dynamics: Dynamics) -> Tracker:
    """How plans are flown with a vehicle."""
    return cascade_tracker(vehicle) if vehicle.airframe is None else reference_tracker(dynamics)
