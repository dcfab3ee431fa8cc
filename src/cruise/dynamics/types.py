"""State of one drone, or of many: components lead, batch axes trail."""

from collections.abc import Callable
from typing import Any, NamedTuple

from jaxtyping import Array, Bool, Float

from cruise.actions import Action, ActionFrame
from cruise.dynamics.parameters import AS_BUILT, Parameters
from cruise.dynamics.quaternion import Quaternion, Vector
from cruise.terms import Term


class RigidBody(NamedTuple):
    """Pose and motion of a quadrotor by Euler angles, or their time derivatives: the paper's."""

    position_w: Float[Array, "3 *B"]  # [m], world, z up
    velocity_w: Float[Array, "3 *B"]  # [m/s], world
    euler: Float[Array, "3 *B"]  # roll, pitch, yaw, ZYX [rad]
    angular_velocity_b: Float[Array, "3 *B"]  # [rad/s], body


class FreeBody(NamedTuple):
    """Pose and motion of a quadrotor by quaternion, or their time derivatives: any attitude is like any other.

    Inside a step the components are apart, tuples of arrays [*B].
    """

    position_w: Vector  # [3, *B] m, world, z up
    velocity_w: Vector  # [3, *B] m/s, world
    attitude: Quaternion  # [4, *B] unit quaternion (w, x, y, z) from body to world
    angular_velocity_b: Vector  # [3, *B] rad/s, body


class DroneState(NamedTuple):
    """A rigid body, what its controller and rotors remember, and how it differs from its vehicle."""

    body: RigidBody | FreeBody
    memory: Any  # arrays [... *B]
    parameters: Parameters = AS_BUILT

    @property
    def position_w(self) -> Float[Array, "3 *B"]:
        """Position in the world [m]."""
        return self.body.position_w

    @property
    def velocity_w(self) -> Float[Array, "3 *B"]:
        """Velocity in the world [m/s]."""
        return self.body.velocity_w

    @property
    def angular_velocity_b(self) -> Float[Array, "3 *B"]:
        """Body rates [rad/s]."""
        return self.body.angular_velocity_b


class Reference(NamedTuple):
    """What a drone is to follow. None: nothing is asked there; a gain of None is the vehicle's."""

    position_w: Float[Array, "3 *B"] | None = None  # [m]
    velocity_w: Float[Array, "3 *B"] | None = None  # [m/s]; beside a position it is fed forward
    acceleration_w: Float[Array, "3 *B"] | None = None  # fed forward [m/s^2]
    heading: Float[Array, "*B"] | None = None  # of the body's x axis [rad]; None: no yaw is asked for
    velocity_gain: float | None = None  # [1/s]
    position_gain: float | None = None  # [1/s]


class Dynamics(NamedTuple):
    """A vehicle as pure functions; everything outside this package sees a drone through these alone.

    `init(position_w, heading, parameters)` is a drone at rest, facing `heading` [rad] where its controller can turn.
    `step(state, action, agility, air_w)` advances one `control_dt`, with the action in [-1, 1]^action_size, `agility`
    its scale (what `action` says holds at the vehicle's usual one), and `air_w` [3, *B] the velocity of the air beyond
    the parameters' wind, or None. `track(state, reference, agility)` is the action that follows a reference.
    `proprioception` is what the drone feels of itself beyond position and velocity, for observations: terms whose
    functions take the state of the drones and give vectors [3, *B] in the world's frame; `internal` the same in its
    own frame, with what is no vector.
    """

    action: Action
    control_dt: float
    init: Callable[..., DroneState]
    step: Callable[..., DroneState]
    euler: Callable[[DroneState], Array]
    proprioception: tuple[Term, ...]
    rotation: Callable[[DroneState], Array]  # R_WB [3, 3, *B]
    internal: tuple[Term, ...]
    track: Callable[[DroneState, Reference, Array | float], Array]
    induced_air: Callable[[DroneState, Bool[Array, "N *B"]], Array] | None = None  # moved by the other drones [m/s]
    groups: tuple[tuple[int, ...], ...] | None = None  # drones by vehicle in a mixed field: see `cruise.env.mixed`

    @property
    def action_size(self) -> int:
        """How many numbers an action has."""
        return self.action.size

    @property
    def action_frame(self) -> ActionFrame:
        """In which frame a policy's action has its directions."""
        return self.action.frame
