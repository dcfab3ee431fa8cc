"""Who flies near a drone, and in what order: what the terms of an observation share of the opponents.

Each function takes the `cruise.env.view.View` that keeps what it gives. Small fields are written out opponent by
opponent, which XLA fuses best on the CPU; large ones are gathered, so that what is traced does not grow with them; an
export takes them as few operations on whole arrays.
"""

import functools
import operator
from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from cruise.env.ranks import counted, counted_ranks, ranks
from cruise.racing import field
from cruise.vector import is_plain, norm, stored

if TYPE_CHECKING:
    from cruise.env.view import View

ABSENT = 1e6  # sorts an opponent that left the air behind all others [m]


class Opponent(NamedTuple):
    """One opponent of every drone; world frame."""

    offset_w: Float[Array, "3 N *B"]  # its position minus the drone's [m]
    motion_w: Float[Array, "3 N *B"]  # its velocity minus the drone's [m/s]
    present: Bool[Array, "N *B"]  # in the air

    @property
    def separation(self) -> Float[Array, "N *B"]:
        """Distance to it [m]."""
        return norm(self.offset_w)


def opponent_of(view: "View", number: int) -> Opponent:
    """Opponent `number` of every drone, 1 to N - 1: drone (i + number) mod N for drone i."""
    position, velocity = view.position_w, view.velocity_w
    if view.state.opponents is not None:
        return _perceived(view, number - 1)
    if is_plain():
        offset, motion, present = view.shared(_everyone)
        return Opponent(offset[:, number - 1], motion[:, number - 1], present[number - 1])
    offset, motion = (field.opponent(vector, number, 1) - vector for vector in (position, velocity))
    return Opponent(offset, motion, field.opponent(view.airborne, number, 0))


def _perceived(view: "View", place: Any) -> Opponent:
    """Opponents in a place of `RaceState.opponents`, or in all of them: those that are not known are not present."""
    known = view.state.opponents
    assert known is not None
    own = view.position_w, view.velocity_w
    if not isinstance(place, int):
        own = own[0][:, None], own[1][:, None]
    return Opponent(known.position_w[:, place] - own[0], known.velocity_w[:, place] - own[1], known.present[place])


def _everyone(view: "View") -> Opponent:
    """All opponents of every drone at once, along an axis before that of the drones: for an export."""
    drones = view.num_drones
    number = (np.arange(1, drones)[:, None] + np.arange(drones)) % drones
    offset, motion = (vector[:, number] - vector[:, None] for vector in (view.position_w, view.velocity_w))
    return Opponent(offset, motion, view.airborne[number])


def nearest_first(view: "View") -> Opponent:
    """All opponents, the nearest first."""
    vectors, present = view.shared(_sorted_vectors)
    return Opponent(vectors[0], vectors[1], present)


def nearest_first_b(view: "View") -> Float[Array, "2 3 K N *B"]:
    """Offsets and motions of all opponents along the drone's axes, the nearest first: for an export."""
    vectors, _ = view.shared(_sorted_vectors)
    return jnp.sum(view.rotation[:, :, None] * vectors[:, :, None], axis=1)


def _sorted_vectors(view: "View") -> tuple[Float[Array, "2 3 K N *B"], Bool[Array, "K N *B"]]:
    """Offsets and motions."""
    offset, motion, present = view.shared(_everyone)
    place = counted(jnp.where(present, norm(offset), ABSENT))
    count = len(place)
    chosen = present & (place == np.arange(count).reshape(-1, *(1,) * place.ndim))
    vectors = jnp.where(chosen, jnp.stack([offset, motion])[:, :, None], 0.0).sum(axis=3)
    return vectors, present.sum(axis=0) > np.arange(count).reshape(-1, *(1,) * (place.ndim - 1))


def _places(view: "View") -> list[Float[Array, "N *B"]]:
    """Of each opponent among those in the air, by distance; 0 is the nearest."""
    others = [view.opponent(number) for number in field.opponents(view.num_drones)]
    separations = [jnp.where(other.present, other.separation, ABSENT) for other in others]
    return [stored(place.astype(jnp.float32)) for place in ranks(separations)]


def _relative(view: "View") -> list[Float[Array, "6 N *B"]]:
    others = [view.opponent(number) for number in field.opponents(view.num_drones)]
    return [jnp.concatenate([other.offset_w, other.motion_w]) for other in others]


def nearest(view: "View", place: int) -> Opponent:
    """The opponent in the air that is nearest, for place 1, or next; zeros where there are fewer."""
    if place >= view.num_drones:
        nothing = jnp.zeros_like(view.position_w)
        return Opponent(nothing, nothing, jnp.zeros_like(view.airborne))
    if is_plain():
        offset, motion, here = view.shared(nearest_first)
        return Opponent(offset[:, place - 1], motion[:, place - 1], here[place - 1])
    if view.is_large:
        offset, motion, present = view.shared(in_order, place - 1, place)
        return Opponent(offset[:, 0], motion[:, 0], present[0])
    present = [view.opponent(number).present for number in field.opponents(view.num_drones)]
    chosen = [here & (at == place - 1) for here, at in zip(present, view.shared(_places), strict=True)]
    picked = [jnp.where(flag, one, 0.0) for flag, one in zip(chosen, view.shared(_relative), strict=True)]
    vectors = stored(functools.reduce(operator.add, picked))
    return Opponent(vectors[:3], vectors[3:], functools.reduce(operator.or_, chosen))


def _all_opponents(view: "View") -> Opponent:
    """Opponents 1 to N - 1 along an axis before that of the drones."""
    if view.state.opponents is not None:
        return _perceived(view, slice(None))
    offset, motion = (field.all_opponents(own, 1) - own[:, None] for own in (view.position_w, view.velocity_w))
    return Opponent(offset, motion, field.all_opponents(view.airborne, 0))


def _order(view: "View") -> Int[Array, "K N *B"]:
    """Indices of all opponents, those in the air first and by distance."""
    others = view.shared(_all_opponents)
    places = counted_ranks(jnp.where(others.present, others.separation, ABSENT))
    number = jnp.arange(len(places)).reshape(-1, *(1,) * (places.ndim - 1))
    number = jnp.broadcast_to(number, places.shape).astype(places.dtype)
    return jnp.put_along_axis(jnp.zeros_like(places), places, number, axis=0, inplace=False)


def in_order(view: "View", first: int, end: int) -> Opponent:
    """From place `first` to before `end`, gathered: what is traced does not grow with the number of drones."""
    order = view.shared(_order)[first:end]
    offset, motion, here = view.shared(_all_opponents)
    present = jnp.take_along_axis(here, order, axis=0)
    offset, motion = (
        jnp.where(present, jnp.take_along_axis(vectors, order[None], axis=1), 0.0) for vectors in (offset, motion)
    )
    return Opponent(offset, motion, present)
