"""The paper's state vector, clipped to [-1, 1], in the paper's order; 13 + G + 4 (N - 1) numbers."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.env.view import View
from cruise.terms import Observation, Setting, Term
from cruise.vector import dot, norm, sin_cos

DISTANCE_MAX = 10.0  # d_max of the paper [m]
SPEED_MAX = 10.0  # v_max of the paper [m/s]
EPSILON = 1e-6

_term = functools.partial(Term, low=-1.0, high=1.0)
_share = functools.partial(Term, low=0.0, high=1.0)


def paper_terms(setting: Setting) -> tuple[Term, ...]:
    """An opponent that has left the air is reported as far away: at no offset and at the largest distance."""
    others = range(1, setting.drones)
    return (
        _term("to_gate", 3, "target gate's centre minus position", "m", DISTANCE_MAX, fn=to_gate_w),
        _share("distance", 1, "to the target gate's centre", "m", DISTANCE_MAX, fn=distance),
        _term("velocity", 3, "velocity", "m/s", SPEED_MAX, fn=lambda view: view.velocity_w),
        _term("closing_speed", 1, "velocity along the line to the gate", "m/s", SPEED_MAX, fn=closing_speed),
        _share("target", setting.gates, "1 at the target gate, 0 at the others", fn=_target),
        _term("position", 3, "position", "m", DISTANCE_MAX, fn=lambda view: view.position_w),
        _term("heading_error", 2, "sine and cosine of yaw minus the gate's yaw", fn=_heading_error),
        *(_opponent_offset(number) for number in others),
        *(_opponent_distance(number) for number in others),
    )


def to_gate_w(view: View) -> Float[Array, "3 N *B"]:
    """From the drone to the centre of its target gate [m]."""
    return view.gate_w() - view.position_w


def distance(view: View) -> Float[Array, "N *B"]:
    """To the centre of the target gate [m]."""
    return norm(view.shared(to_gate_w))


def closing_speed(view: View) -> Float[Array, "N *B"]:
    """Velocity along the line to the gate [m/s]."""
    return dot(view.velocity_w, view.shared(to_gate_w)) / (view.shared(distance) + EPSILON)


def _target(view: View) -> Float[Array, "G N *B"]:
    return jax.nn.one_hot(view.gate_index(), view.num_gates, axis=0)


def _heading_error(view: View) -> Float[Array, "2 N *B"]:
    (cos_gate, sin_gate), (sin_yaw, cos_yaw) = view.gate_heading_w(), sin_cos(view.euler[2])
    return jnp.stack([sin_yaw * cos_gate - cos_yaw * sin_gate, cos_yaw * cos_gate + sin_yaw * sin_gate])


def _opponent_offset(number: int) -> Term:
    def offset(view: View) -> Array:
        other = view.opponent(number)
        return jnp.where(other.present, other.offset_w, 0.0)

    return _term(f"opponent_{number}_offset", 3, "opponent's position minus own", "m", DISTANCE_MAX, fn=offset)


def _opponent_distance(number: int) -> Term:
    def separation(view: View) -> Array:
        other = view.opponent(number)
        return jnp.where(other.present, other.separation, DISTANCE_MAX)

    return _share(f"opponent_{number}_distance", 1, "to it", "m", DISTANCE_MAX, fn=separation)


PAPER = Observation("paper", paper_terms, about="The paper's vector, to compare with it.")
