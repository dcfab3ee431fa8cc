"""From a plan to an action: one small class for each kind of vehicle. The plan itself knows no vehicle.

`ahead` is where the drones will be when a command given now begins to act, whatever it is: position [m] and velocity
[m/s]. Plans begin there. `command` is the action that follows a trajectory which begins there. `limit` says whether the
vehicle's acceleration is limited as a whole or on every axis of the world by itself.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Vehicle
from cruise.dynamics import DroneState, Dynamics, Reference, RigidBody
from cruise.pilots.se_ibr.options import Limit
from cruise.pilots.se_ibr.trajectory import Trajectory


class Moment(NamedTuple):
    """What a tracker knows beside the trajectory."""

    drones: DroneState
    age: Array | float  # since the plan was made [s]
    lead: Array | float  # the wanted acceleration reaches the plan's velocity so much later [s]
    agility: float  # scale of the action


@dataclass(frozen=True)
class CascadeTracker:
    """The paper's cascade, inverted.

    A tilt follows the command as a second-order system; under the cascade's explicit Euler steps of h, with a the
    acceleration of the tilt and b its rate,

        a(t+1) = a(t) + h b(t),  b(t+1) = (1 - h d) b(t) + h k (command(t) - a(t)),

    so that a command first moves a(t+2), and that acceleration can be chosen. Thrust acts at once. Where the vehicle is
    told a velocity or a point, it is told the one of which its loops make that command.
    """

    vehicle: Vehicle
    dynamics: Dynamics
    limit: Limit = "box"

    def ahead(self, drones: DroneState) -> tuple[Array, Array]:
        """In two steps; the vertical velocity is taken to stay."""
        h = self.vehicle.control_dt
        now, after, _ = self._tilt(drones)
        still = jnp.zeros_like(now[:1])
        now, after = jnp.concatenate([now, still]), jnp.concatenate([after, still])
        velocity = drones.velocity_w
        return drones.position_w + 2 * h * velocity + h * h * now, velocity + h * (now + after)

    def command(self, trajectory: Trajectory, moment: Moment) -> Float[Array, "3 N *B"]:
        """What reaches the plan's velocity of `lead` later by a constant acceleration."""
        _, velocity = self.ahead(moment.drones)
        wanted = (trajectory.velocity_at(moment.age + moment.lead) - velocity) / moment.lead
        action = self._action(self._commanded(wanted, moment.drones), moment)
        if self.vehicle.told_directly:
            return action
        return self.dynamics.track(moment.drones, Reference(acceleration_w=moment.agility * action), moment.agility)

    def _tilt(self, drones: DroneState) -> tuple[Array, Array, Array]:
        """Horizontal accelerations a(t), a(t+1) [m/s^2], and the rate b(t+1) under no command [m/s^3]."""
        h, k, d = self._loop()
        roll, pitch, _ = _euler(drones)
        p, q, _ = drones.angular_velocity_b
        now, rate = self.vehicle.gravity * jnp.stack([pitch, -roll]), self.vehicle.gravity * jnp.stack([q, -p])
        return now, now + h * rate, (1 - h * d) * rate - h * k * now

    def _commanded(self, wanted: Array, drones: DroneState) -> Array:
        """The command that gives a wanted acceleration: in two steps horizontally, now vertically [m/s^2]."""
        (h, k, _), g = self._loop(), self.vehicle.gravity
        _, after, rate = self._tilt(drones)
        level = ((wanted[:2] - after) / h - rate) / (h * k)
        roll, pitch, _ = _euler(drones)
        up = (g + wanted[2]) / (jnp.cos(roll) * jnp.cos(pitch)) - g
        return jnp.concatenate([level, up[None]])

    def _action(self, commanded: Array, moment: Moment) -> Array:
        """The velocity error whose PD law gives a command (`cruise.dynamics.cascade`), over the action's scale."""
        gains = self.vehicle.controller
        kept = gains.position_p * gains.velocity_d * moment.drones.memory
        error = commanded + gains.position_d * moment.drones.velocity_w + kept
        error = error / (gains.position_p * (gains.velocity_p + gains.velocity_d))
        return jnp.clip(error / (moment.agility * self.vehicle.control_dt), -1.0, 1.0)

    def _loop(self) -> tuple[float, float, float]:
        """Of the tilt: h [s], k [1/s^2] and d [1/s]."""
        gains, inertia = self.vehicle.controller, self.vehicle.inertia[0]
        return self.vehicle.control_dt, gains.attitude_p / inertia, gains.attitude_d / inertia


def _euler(drones: DroneState) -> Array:
    assert isinstance(drones.body, RigidBody)
    return drones.body.euler


@dataclass(frozen=True)
class ReferenceTracker:
    """A vehicle that follows position, velocity and acceleration by itself, and acts at once."""

    dynamics: Dynamics
    limit: Limit = "ball"

    def ahead(self, drones: DroneState) -> tuple[Array, Array]:
        """Where they are."""
        return drones.position_w, drones.velocity_w

    def command(self, trajectory: Trajectory, moment: Moment) -> Float[Array, "A N *B"]:
        """As the vehicle's own loops follow the plan."""
        return self.dynamics.track(moment.drones, trajectory.at(moment.age), moment.agility)


Tracker = CascadeTracker | ReferenceTracker


def tracker_of(vehicle: Vehicle, dynamics: Dynamics) -> Tracker:
    """How plans are flown with a vehicle."""
    return CascadeTracker(vehicle, dynamics) if vehicle.flown_by == "cascade" else ReferenceTracker(dynamics)
