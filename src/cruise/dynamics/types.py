"""State of one drone, or of many: components lead, batch axes trail."""

from collections.abc import Callable
from typing import NamedTuple

from jaxtyping import Array, Float


class RigidBody(NamedTuple):
    """Pose and motion of a quadrotor, or their time derivatives."""

    position_w: Float[Array, "3 *B"]  # [m], world, z up
    velocity_w: Float[Array, "3 *B"]  # [m/s], world
    euler: Float[Array, "3 *B"]  # roll, pitch, yaw, ZYX [rad]
    angular_velocity_b: Float[Array, "3 *B"]  # [rad/s], body


class DroneState(NamedTuple):
    """A rigid body and what its controller remembers."""

    body: RigidBody
    memory: Float[Array, "M *B"]

    @property
    def position_w(self) -> Float[Array, "3 *B"]:
        """Position in the world [m]."""
        return self.body.position_w

    @property
    def velocity_w(self) -> Float[Array, "3 *B"]:
        """Velocity in the world [m/s]."""
        return self.body.velocity_w


class Dynamics(NamedTuple):
    """A vehicle as pure functions; everything outside this package sees a drone through these alone.

    `init(position_w, heading)` is a drone at rest, facing `heading` [rad] where its controller can turn.
    `step(state, action, agility)` advances one `control_dt`, with the action in [-1, 1]^action_size and `agility` its
    scale. `proprioception` is what the drone feels of itself beyond position and velocity, for observations: vectors
    [3, *B] in the world's frame, scaled to order one.
    """

    action_size: int
    control_dt: float
    init: Callable[[Array, Array], DroneState]
    step: Callable[[DroneState, Array, Array | float], DroneState]
    euler: Callable[[DroneState], Array]
    proprioception: Callable[[DroneState], tuple[Array, ...]]
