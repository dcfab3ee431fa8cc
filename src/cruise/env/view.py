"""What the terms of an observation look at: all drones of a race, or of many, as they perceive it.

It is the one place that knows how a course keeps its gates.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from cruise.dynamics.types import DroneState, Dynamics
from cruise.env import opponents as others
from cruise.env.opponents import Opponent
from cruise.env.types import RaceState
from cruise.geometry import from_gate, to_gate
from cruise.racing.course import Course, Opening, target_opening
from cruise.racing.field import UNROLLED
from cruise.vector import dot, is_plain, stored

LAST = -1  # so many gates ahead is the one before the target, which was passed last


def out_of_gate_frame(
    course: Course, next_gate: Int[Array, "*B"], vector: Float[Array, "3 *B"]
) -> Float[Array, "3 *B"]:
    """A vector along (forward, left, up) of each drone's target gate, in the world."""
    gate = target_opening(course, next_gate)
    return jnp.stack(from_gate(gate.normal_w, vector, gate.tilt))


class Sharing:
    """Keeps what several terms ask of it, so that it is computed once."""

    def __init__(self) -> None:
        """Nothing is computed yet."""
        self._kept: dict[tuple, Any] = {}

    def shared(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """`function(self, *arguments)`, computed once for all terms that ask for it."""
        key = (function, *arguments)
        if key not in self._kept:
            self._kept[key] = function(self, *arguments)
        return self._kept[key]


class View(Sharing):
    """Every drone's own flight, its gates and its opponents. Components lead, then drones N, then races *B.

    What several terms share is computed at the first use and kept. SI units; `_w` is the world's frame, `_b` forward,
    left, up of the drone's body.
    """

    def __init__(self, course: Course, dynamics: Dynamics, state: RaceState) -> None:
        """Nothing is computed yet."""
        super().__init__()
        self.course, self.dynamics, self.state = course, dynamics, state

    @property
    def drones(self) -> DroneState:
        """Bodies, and what their controllers remember."""
        return self.state.drones

    @property
    def num_drones(self) -> int:
        """N."""
        return self.position_w.shape[1]

    @property
    def is_large(self) -> bool:
        """Whether opponents are so many that they are gathered by arrays of indices, and not written out."""
        return self.num_drones > UNROLLED and not is_plain()

    @property
    def num_gates(self) -> int:
        """G, in a lap."""
        return self.course.num_gates

    @property
    def position_w(self) -> Float[Array, "3 N *B"]:
        """Own position [m]."""
        return self.state.drones.position_w

    @property
    def velocity_w(self) -> Float[Array, "3 N *B"]:
        """Own velocity [m/s]."""
        return self.state.drones.velocity_w

    @property
    def airborne(self) -> Bool[Array, "N *B"]:
        """Still racing."""
        return self.state.airborne

    @functools.cached_property
    def euler(self) -> Float[Array, "3 N *B"]:
        """Own roll, pitch, yaw, ZYX [rad]."""
        return self.dynamics.euler(self.state.drones)

    @functools.cached_property
    def rotation(self) -> Float[Array, "3 3 N *B"]:
        """R_WB: turns vectors of the body into the world."""
        return stored(self.dynamics.rotation(self.state.drones))

    def to_body(self, vector_w: Float[Array, "3 N *B"]) -> Float[Array, "3 N *B"]:
        """R^T v: a world vector along the body's axes."""
        if is_plain():
            return jnp.sum(self.rotation * vector_w[:, None], axis=0)
        return jnp.stack([dot(self.rotation[:, axis], vector_w) for axis in range(3)])

    @property
    def frame_width(self) -> Float[Array, ""]:
        """Of the solid border around every opening [m]."""
        return self.course.frame_width

    def gate_index(self, ahead: int = 0) -> Int[Array, "N *B"]:
        """Which gate is the target, or so many after it; `LAST` is the one before it."""
        if ahead == 0:
            return self.state.next_gate
        later = self.state.next_gate + ahead
        if not is_plain():
            return later % self.num_gates
        gates = jnp.full_like(later, self.num_gates)  # no remainder of it by itself: an export may not know it
        return jax.lax.rem(later + gates if ahead < 0 else later, gates)

    def gate(self, ahead: int = 0) -> Opening:
        """The target gate of every drone, or the one so many after it."""
        return self.shared(_gate, ahead)

    def gate_w(self, ahead: int = 0) -> Float[Array, "3 N *B"]:
        """Centre of that gate [m]."""
        return self.gate(ahead).position_w

    def gate_forward_w(self, ahead: int = 0) -> Float[Array, "3 N *B"]:
        """Direction of flight through that gate."""
        return self.from_gate_frame((1.0, 0.0, 0.0), ahead)

    def gate_heading_w(self, ahead: int = 0) -> Float[Array, "2 N *B"]:
        """Cosine and sine of the yaw of that gate."""
        return self.gate(ahead).normal_w

    def gate_corners_b(self, ahead: int = 0) -> tuple[Float[Array, "3 N *B"], ...]:
        """From the drone to the corners of its opening, upper left, lower left, lower right, upper right [m]."""
        return self.shared(_corners_b, ahead)

    def to_gate_frame(self, vector_w: Float[Array, "3 N *B"], ahead: int = 0) -> Float[Array, "3 N *B"]:
        """A world vector, or one for each of several opponents, along (forward, left, up) of that gate."""
        return _along(self.gate(ahead), vector_w)

    def from_gate_frame(self, vector: tuple[Any, Any, Any], ahead: int = 0) -> Float[Array, "3 N *B"]:
        """A vector along (forward, left, up) of that gate, in the world."""
        gate = self.gate(ahead)
        parts = from_gate(gate.normal_w, vector, gate.tilt)
        return jnp.stack([jnp.broadcast_to(part, self.airborne.shape) for part in parts])

    def to_pole_w(self, number: int) -> Float[Array, "2 N *B"]:
        """Level offset from the drone to the axis of a pole of the track, by its number from 0 [m]; 0 without one."""
        here = self.position_w[:2]
        table = (self.course.solids or {}).get("pole")
        if table is None or number >= table.shape[1]:
            return jnp.zeros_like(here)
        axis = table[:2, number]
        return axis.reshape(2, *(1,) * (here.ndim - axis.ndim), *axis.shape[1:]) - here

    def to_opening(
        self, position_w: Float[Array, "3 N *B"], margin: float = 0.0, gate: Opening | None = None
    ) -> Float[Array, "N *B"]:
        """Distance [m] to the nearest point of the target's opening, or another's, shrunk by `margin` on every side."""
        gate = self.gate() if gate is None else gate
        forward, left, up = _along(gate, position_w - gate.position_w)
        half_width, half_height = (jnp.maximum(half - margin, 0.0) for half in gate.half_size)
        beside, above = jnp.maximum(jnp.abs(left) - half_width, 0.0), jnp.maximum(jnp.abs(up) - half_height, 0.0)
        square = jnp.sqrt(forward**2 + beside**2 + above**2)
        if gate.is_round is None:
            return square
        outside = jnp.maximum(jnp.sqrt(left**2 + up**2) - half_width, 0.0)
        return jnp.where(gate.is_round[0], jnp.sqrt(forward**2 + outside**2), square)

    def nearest_b(self, place: int) -> tuple[Float[Array, "3 N *B"], Float[Array, "3 N *B"]]:
        """Offset and motion of `nearest` along the body's axes."""
        if is_plain() and place < self.num_drones:
            offset_b, motion_b = self.shared(others.nearest_first_b)
            return offset_b[:, place - 1], motion_b[:, place - 1]
        one = self.nearest(place)
        return self.to_body(one.offset_w), self.to_body(one.motion_w)

    def opponent(self, number: int) -> Opponent:
        """Opponent `number` of every drone, 1 to N - 1: drone (i + number) mod N for drone i."""
        return self.shared(others.opponent_of, number)

    def nearest(self, place: int) -> Opponent:
        """The opponent in the air that is nearest, for place 1, or next; zeros where there are fewer."""
        return self.shared(others.nearest, place)

    @functools.cached_property
    def all_nearest(self) -> Opponent:
        """All N - 1 opponents, those in the air first and by distance, along an axis before that of the drones."""
        if self.is_large:
            in_order: Opponent = self.shared(others.in_order, 0, self.num_drones - 1)
            return in_order
        each = [self.nearest(place) for place in range(1, self.num_drones)]
        offset, motion = (jnp.stack([other[i] for other in each], axis=1) for i in range(2))
        return Opponent(offset, motion, jnp.stack([other.present for other in each]))


def _spread(table: Float[Array, "C N *B"], ndim: int) -> Array:
    """With axes of length 1 after the first, up to so many axes."""
    return table.reshape(table.shape[0], *(1,) * (ndim - table.ndim), *table.shape[1:])


def _along(gate: Opening, vector_w: Float[Array, "3 N *B"]) -> Float[Array, "3 N *B"]:
    """A world vector along (forward, left, up) of a gate."""
    tilt = None if gate.tilt is None else _spread(gate.tilt, vector_w.ndim)
    return jnp.stack(to_gate(_spread(gate.normal_w, vector_w.ndim), vector_w, tilt))


def _gate(view: View, ahead: int) -> Opening:
    return target_opening(view.course, view.gate_index(ahead))


def _corners_b(view: View, ahead: int) -> tuple[Array, ...]:
    half_width, half_height = view.gate(ahead).half_size
    if is_plain() and view.gate(ahead).tilt is None:
        return tuple(_all_corners_b(view, ahead))
    centre = stored(view.to_body(view.gate_w(ahead) - view.position_w))
    left = stored(view.to_body(view.from_gate_frame((0.0, half_width, 0.0), ahead)))
    if view.gate(ahead).tilt is None:
        up = view.rotation[2] * half_height
    else:
        up = stored(view.to_body(view.from_gate_frame((0.0, 0.0, half_height), ahead)))
    return tuple(centre + sideways * left + upwards * up for sideways, upwards in ((1, 1), (1, -1), (-1, -1), (-1, 1)))


CORNERS = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]], np.float32)  # left and up


def _all_corners_b(view: View, ahead: int) -> Float[Array, "4 3 N *B"]:
    """The corners of an upright opening at once: for an export."""
    gate, ones = view.gate(ahead), (1,) * view.airborne.ndim
    sideways = gate.normal_w[::-1] * np.array([-1, 1], np.float32).reshape(2, *ones) * gate.half_size[0]
    reach = jnp.concatenate([sideways, gate.half_size[1:]])
    corners_w = gate.position_w - view.position_w + CORNERS[:, [0, 0, 1]].reshape(4, 3, *ones) * reach
    return jnp.sum(view.rotation * corners_w[:, :, None], axis=1)
