"""What the terms of an observation look at: all drones of a race, or of many, as they perceive it.

It is the one place that knows how a course keeps its gates.
"""

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from cruise.dynamics.types import DroneState, Dynamics
from cruise.env.ranks import counted_ranks, ranks
from cruise.env.types import RaceState
from cruise.geometry import from_gate, to_gate
from cruise.racing.course import Course, Opening, target_opening
from cruise.racing.field import UNROLLED, all_opponents, opponent, opponents
from cruise.vector import dot, is_plain, norm, stored

ABSENT = 1e6  # sorts an opponent that left the air behind all others [m]


def out_of_gate_frame(
    course: Course, next_gate: Int[Array, "*B"], vector: Float[Array, "3 *B"]
) -> Float[Array, "3 *B"]:
    """A vector along (forward, left, up) of each drone's target gate, in the world."""
    gate = target_opening(course, next_gate)
    return jnp.stack(from_gate(gate.normal_w, vector, gate.tilt))


class Opponent(NamedTuple):
    """One opponent of every drone; world frame."""

    offset_w: Float[Array, "3 N *B"]  # its position minus the drone's [m]
    motion_w: Float[Array, "3 N *B"]  # its velocity minus the drone's [m/s]
    present: Bool[Array, "N *B"]  # in the air

    @property
    def separation(self) -> Float[Array, "N *B"]:
        """Distance to it [m]."""
        return norm(self.offset_w)


class View:
    """Every drone's own flight, its gates and its opponents. Components lead, then drones N, then races *B.

    What several terms share is computed at the first use and kept. SI units; `_w` is the world's frame, `_b` forward,
    left, up of the drone's body.
    """

    def __init__(self, course: Course, dynamics: Dynamics, state: RaceState) -> None:
        """Nothing is computed yet."""
        self.course, self.dynamics, self.state = course, dynamics, state
        self._kept: dict[tuple, Any] = {}

    def shared(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """`function(view, *arguments)`, computed once for all terms that ask for it."""
        key = (function, *arguments)
        if key not in self._kept:
            self._kept[key] = function(self, *arguments)
        return self._kept[key]

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
        return jnp.stack([dot(self.rotation[:, axis], vector_w) for axis in range(3)])

    def gate_index(self, ahead: int = 0) -> Int[Array, "N *B"]:
        """Which gate is the target, or so many after it."""
        return self.state.next_gate if ahead == 0 else (self.state.next_gate + ahead) % self.course.num_gates

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
        gate = self.gate(ahead)
        tilt = None if gate.tilt is None else _spread(gate.tilt, vector_w.ndim)
        return jnp.stack(to_gate(_spread(gate.normal_w, vector_w.ndim), vector_w, tilt))

    def from_gate_frame(self, vector: tuple[Any, Any, Any], ahead: int = 0) -> Float[Array, "3 N *B"]:
        """A vector along (forward, left, up) of that gate, in the world."""
        gate = self.gate(ahead)
        parts = from_gate(gate.normal_w, vector, gate.tilt)
        return jnp.stack([jnp.broadcast_to(part, self.airborne.shape) for part in parts])

    def to_opening(self, position_w: Float[Array, "3 N *B"], margin: float = 0.0) -> Float[Array, "N *B"]:
        """Distance [m] to the nearest point of the target's opening, shrunk by `margin` on every side."""
        gate = self.gate()
        forward, left, up = self.to_gate_frame(position_w - gate.position_w)
        half_width, half_height = (jnp.maximum(half - margin, 0.0) for half in gate.half_size)
        beside, above = jnp.maximum(jnp.abs(left) - half_width, 0.0), jnp.maximum(jnp.abs(up) - half_height, 0.0)
        square = jnp.sqrt(forward**2 + beside**2 + above**2)
        if gate.is_round is None:
            return square
        outside = jnp.maximum(jnp.sqrt(left**2 + up**2) - half_width, 0.0)
        return jnp.where(gate.is_round[0], jnp.sqrt(forward**2 + outside**2), square)

    def opponent(self, number: int) -> Opponent:
        """Opponent `number` of every drone, 1 to N - 1: drone (i + number) mod N for drone i."""
        return self.shared(_opponent, number)

    def nearest(self, place: int) -> Opponent:
        """The opponent in the air that is nearest, for place 1, or next; zeros where there are fewer."""
        return self.shared(_nearest, place)

    @functools.cached_property
    def all_nearest(self) -> Opponent:
        """All N - 1 opponents, those in the air first and by distance, along an axis before that of the drones."""
        if self.is_large:
            in_order: Opponent = self.shared(_in_order, 0, self.num_drones - 1)
            return in_order
        others = [self.nearest(place) for place in range(1, self.num_drones)]
        offset, motion = (jnp.stack([other[i] for other in others], axis=1) for i in range(2))
        return Opponent(offset, motion, jnp.stack([other.present for other in others]))


def _spread(table: Float[Array, "C N *B"], ndim: int) -> Array:
    """With axes of length 1 after the first, up to so many axes."""
    return table.reshape(table.shape[0], *(1,) * (ndim - table.ndim), *table.shape[1:])


def _gate(view: View, ahead: int) -> Opening:
    return target_opening(view.course, view.gate_index(ahead))


def _corners_b(view: View, ahead: int) -> tuple[Array, ...]:
    half_width, half_height = view.gate(ahead).half_size
    centre = stored(view.to_body(view.gate_w(ahead) - view.position_w))
    left = stored(view.to_body(view.from_gate_frame((0.0, half_width, 0.0), ahead)))
    if view.gate(ahead).tilt is None:
        up = view.rotation[2] * half_height
    else:
        up = stored(view.to_body(view.from_gate_frame((0.0, 0.0, half_height), ahead)))
    return tuple(centre + sideways * left + upwards * up for sideways, upwards in ((1, 1), (1, -1), (-1, -1), (-1, 1)))


def _opponent(view: View, number: int) -> Opponent:
    position, velocity = view.position_w, view.velocity_w
    offset, motion = (opponent(vector, number, 1) - vector for vector in (position, velocity))
    return Opponent(offset, motion, opponent(view.airborne, number, 0))


def _places(view: View) -> list[Float[Array, "N *B"]]:
    """Of each opponent among those in the air, by distance; 0 is the nearest."""
    others = [view.opponent(number) for number in opponents(view.num_drones)]
    separations = [jnp.where(other.present, other.separation, ABSENT) for other in others]
    return [stored(place.astype(jnp.float32)) for place in ranks(separations)]


def _relative(view: View) -> list[Float[Array, "6 N *B"]]:
    others = [view.opponent(number) for number in opponents(view.num_drones)]
    return [jnp.concatenate([other.offset_w, other.motion_w]) for other in others]


def _nearest(view: View, place: int) -> Opponent:
    if place >= view.num_drones:
        nothing = jnp.zeros_like(view.position_w)
        return Opponent(nothing, nothing, jnp.zeros_like(view.airborne))
    if view.is_large:
        offset, motion, present = view.shared(_in_order, place - 1, place)
        return Opponent(offset[:, 0], motion[:, 0], present[0])
    present = [view.opponent(number).present for number in opponents(view.num_drones)]
    chosen = [here & (at == place - 1) for here, at in zip(present, view.shared(_places), strict=True)]
    picked = [jnp.where(flag, one, 0.0) for flag, one in zip(chosen, view.shared(_relative), strict=True)]
    vectors = stored(functools.reduce(operator.add, picked))
    return Opponent(vectors[:3], vectors[3:], functools.reduce(operator.or_, chosen))


def _all_opponents(view: View) -> Opponent:
    """Opponents 1 to N - 1 along an axis before that of the drones."""
    offset, motion = (all_opponents(own, 1) - own[:, None] for own in (view.position_w, view.velocity_w))
    return Opponent(offset, motion, all_opponents(view.airborne, 0))


def _order(view: View) -> Int[Array, "K N *B"]:
    """Indices of all opponents, those in the air first and by distance."""
    others = view.shared(_all_opponents)
    places = counted_ranks(jnp.where(others.present, others.separation, ABSENT))
    number = jnp.arange(len(places)).reshape(-1, *(1,) * (places.ndim - 1))
    number = jnp.broadcast_to(number, places.shape).astype(places.dtype)
    return jnp.put_along_axis(jnp.zeros_like(places), places, number, axis=0, inplace=False)


def _in_order(view: View, first: int, end: int) -> Opponent:
    """From place `first` to before `end`, gathered: what is traced does not grow with the number of drones."""
    order = view.shared(_order)[first:end]
    offset, motion, here = view.shared(_all_opponents)
    present = jnp.take_along_axis(here, order, axis=0)
    offset, motion = (
        jnp.where(present, jnp.take_along_axis(vectors, order[None], axis=1), 0.0) for vectors in (offset, motion)
    )
    return Opponent(offset, motion, present)
