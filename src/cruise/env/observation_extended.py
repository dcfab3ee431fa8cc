"""Own flight, the next three gates, and opponents nearest first, all in the frame of the target gate.

Seen so, every gate looks alike, and what is learned at one serves at all. Beyond the paper's vector it knows the
drone's own attitude, the gates after the target, where the drone would cross the target's plane and how near it would
come to each opponent if everybody kept their velocity. Of 20 + 3 P + 9 (N - 1) numbers, with P vectors of the
vehicle's proprioception, clipped to [-3, 3].
"""

import dataclasses
import functools
from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.env.observation_paper import DISTANCE_MAX, closing_speed, distance
from cruise.env.view import View
from cruise.terms import LIMIT, Observation, Setting, Term
from cruise.vector import dot, norm

GATE_RANGE, OPPONENT_RANGE, SPEED_RANGE, HEIGHT_RANGE = 5.0, 3.0, 5.0, 4.0  # scales [m], [m/s]
NOTICE = 5.0  # an opponent farther away than this is not seen, one within half of it is seen whole [m]
LOOK_AHEAD = 3.0  # how far constant velocity is trusted [s]
MIN_CLOSING_SPEED = 0.5  # [m/s]

_term = functools.partial(Term, frame="gate")


def extended_terms(setting: Setting) -> tuple[Term, ...]:
    """In the order of the vector."""
    where = "where, left and up, the gate's plane would be crossed at this velocity"
    return (
        _term("place", 3, "position minus the target gate's centre", "m", GATE_RANGE, fn=_place),
        _term("distance", 1, "to the target gate's centre", "m", DISTANCE_MAX, low=0.0, fn=distance),
        _term("second_gate", 3, "the gate after the target minus the target", "m", DISTANCE_MAX, fn=_leg(0)),
        _term("third_gate", 3, "the one after that minus the second", "m", DISTANCE_MAX, fn=_leg(1)),
        _term("second_normal", 2, "normal of the second gate, forward and left", fn=_second_normal),
        _term("velocity", 3, "velocity", "m/s", SPEED_RANGE, fn=_velocity),
        _term("closing_speed", 1, "velocity along the line to the gate", "m/s", SPEED_RANGE, fn=closing_speed),
        _term("height", 1, "above the ground", "m", HEIGHT_RANGE, fn=lambda view: view.position_w[2]),
        _term("crossing", 2, where, "m", 2.0, fn=_crossing),
        _term("crossing_time", 1, "and when", "s", LOOK_AHEAD, low=0.0, fn=_crossing_time),
        *(_in_gate_frame(felt) for felt in setting.dynamics.proprioception),
        *(term for place in range(1, setting.drones) for term in _opponent(place)),
    )


def _place(view: View) -> Float[Array, "3 N *B"]:
    return view.to_gate_frame(view.position_w - view.gate_w())


def _velocity(view: View) -> Float[Array, "3 N *B"]:
    return view.to_gate_frame(view.velocity_w)


def _leg(ahead: int) -> Callable[[View], Array]:
    """From the gate `ahead` of the target to the one after it."""
    return lambda view: view.to_gate_frame(view.gate_w(ahead + 1) - view.gate_w(ahead))


def _second_normal(view: View) -> Float[Array, "2 N *B"]:
    return view.to_gate_frame(view.gate_forward_w(1))[:2]


def _crossing_time(view: View) -> Float[Array, "N *B"]:
    """When the drone would cross the target's plane at this velocity [s]."""
    closing = jnp.maximum(view.shared(_velocity)[0], MIN_CLOSING_SPEED)
    return jnp.clip(-view.shared(_place)[0] / closing, 0.0, LOOK_AHEAD)


def _crossing(view: View) -> Float[Array, "2 N *B"]:
    """Where, left and up of the target's centre [m]."""
    return view.shared(_place)[1:] + view.shared(_velocity)[1:] * view.shared(_crossing_time)


def _in_gate_frame(felt: Term) -> Term:
    """What the vehicle feels of itself, a vector in the world, along the gate's axes."""
    return dataclasses.replace(felt, frame="gate", fn=lambda view: view.to_gate_frame(felt.fn(view.drones)))


def _opponent(place: int) -> tuple[Term, ...]:
    """Nine numbers, all 0 for one that left the air or is far away.

    They fade out with distance: where a drone that no race ever showed is far off, the policy flies as if alone.
    """

    def term(name: str, size: int, quantity: str, unit: str, scale: float, low: float = -LIMIT) -> Term:
        bounds = (low * scale, LIMIT * scale)
        fn = functools.partial(_seen, name=name, bounds=bounds, place=place)
        return _term(f"opponent_{place}_{name}", size, quantity, unit, scale, low=low, fn=fn)

    offset = (
        "position minus own; opponents nearest first, zeros for one that left the air; all of it, when clipped, "
        "fades from whole at 2.5 m to nothing at 5 m"
    )
    return (
        term("offset", 3, offset, "m", OPPONENT_RANGE),
        term("motion", 3, "velocity minus own", "m/s", OPPONENT_RANGE),
        term("closeness", 1, "exp(-distance / 1 m)", "", 1.0, low=0.0),
        term("approach_time", 1, "until the two are nearest at constant velocities", "s", LOOK_AHEAD, low=0.0),
        term("approach_closeness", 1, "exp(-distance / 1 m) then", "", 1.0, low=0.0),
    )


def _seen(view: View, name: str, bounds: tuple[float, float], place: int) -> Float[Array, "K N *B"]:
    return view.shared(_faded, name, bounds)[:, place - 1]


def _faded(view: View, name: str, bounds: tuple[float, float]) -> Float[Array, "K P N *B"]:
    """Of all opponents, the nearest first; clipped before it fades."""
    return view.shared(_weight) * jnp.clip(view.shared(_RELATIVE[name]), *bounds)


def _weight(view: View) -> Float[Array, "P N *B"]:
    others = view.all_nearest
    return jnp.where(others.present, noticed(others.separation, NOTICE), 0.0)


def _offset(view: View) -> Float[Array, "3 P N *B"]:
    return view.to_gate_frame(view.all_nearest.offset_w)


def _motion(view: View) -> Float[Array, "3 P N *B"]:
    return view.to_gate_frame(view.all_nearest.motion_w)


def _closeness(view: View) -> Float[Array, "1 P N *B"]:
    return jnp.exp(-view.all_nearest.separation)[None]


def _approach_time(view: View) -> Float[Array, "1 P N *B"]:
    """Until the two are nearest, if both keep their velocities [s]."""
    offset, motion, _ = view.all_nearest
    return jnp.clip(-dot(offset, motion) / jnp.maximum(dot(motion, motion), 0.01), 0.0, LOOK_AHEAD)[None]


def _approach_closeness(view: View) -> Float[Array, "1 P N *B"]:
    offset, motion, _ = view.all_nearest
    return jnp.exp(-norm(offset + motion * view.shared(_approach_time)))[None]


_RELATIVE = {
    "offset": _offset,
    "motion": _motion,
    "closeness": _closeness,
    "approach_time": _approach_time,
    "approach_closeness": _approach_closeness,
}


def noticed(separation: Float[Array, "*B"], notice: float) -> Float[Array, "*B"]:
    """How much of an opponent so far away is seen: all within half of `notice`, nothing beyond it [m]."""
    return jnp.clip(2.0 - 2.0 * separation / notice, 0.0, 1.0)


EXTENDED = Observation(
    "extended",
    extended_terms,
    action_frame="gate",
    about="All that matters, in the frame of the target gate: the default.",
)
