"""What `body` tells, and what a network would have to find out of it: where a drone is as its gates see it.

The corners of an opening say all of a gate, but its heading is in their differences alone, which are small beside 10 m.
A policy that must fly any track needs it plainly: along the drone's axes the directions to the gates and their normals,
and in the frames of the gates its own place, its speed and how far it is from their posts. Of opponents, where they
stand as the target gate sees them, which says who will be there first, and how fast they come nearer. The size does not
depend on the number of drones. Clipped to [-3, 3].
"""

import functools
import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.env.observation_body import GATES_AHEAD, GATES_FAR_AHEAD, NEAREST, NOTICE, body_terms, fading
from cruise.env.view import LAST, View
from cruise.terms import Observation, Setting, Term
from cruise.vector import dot, norm

PLACE_RANGE, GATE_SPEED, CLOSING = 4.0, 8.0, 5.0  # scales [m, m/s, m/s]
NEAR_GATE, NEAR_DRONE = 0.5, 0.3  # added to distances before they are inverted [m]


def racing_terms(setting: Setting, gates: int = GATES_AHEAD, notice: float = math.inf) -> tuple[Term, ...]:
    """In the order of the vector: `body`, gates ahead, the gate passed last, opponents."""
    return (
        *body_terms(setting, gates=gates, notice=notice),
        *(term for ahead in range(gates) for term in _gate(ahead)),
        *(_edges(f"gate_{ahead + 1}", ahead) for ahead in range(gates)),
        Term("motion_at_gate", 3, "own velocity", "m/s", GATE_SPEED, frame="gate", fn=_motion_at_gate),
        Term(
            "nearness", 1, "1 / (0.5 m + distance to the target's centre)", "1/m", frame="body", low=0.0, fn=_nearness
        ),
        _place("last_gate", LAST),
        _normal("last_gate", LAST),
        _edges("last_gate", LAST),
        *(term for place in range(1, NEAREST + 1) for term in _opponent(place, notice)),
    )


def _gate(ahead: int) -> tuple[Term, ...]:
    name = f"gate_{ahead + 1}"
    direction = functools.partial(_direction, ahead)
    return (
        Term(f"{name}_direction", 3, "from the drone to its centre", frame="body", fn=direction),
        _normal(name, ahead),
        _place(name, ahead),
    )


def _normal(name: str, ahead: int) -> Term:
    return Term(
        f"{name}_normal", 3, "direction of flight through it", frame="body", fn=functools.partial(_facing, ahead)
    )


def _place(name: str, ahead: int) -> Term:
    quantity = f"own position in the frame of {_which(ahead)}: forward, left, up"
    return Term(f"{name}_place", 3, quantity, "m", PLACE_RANGE, frame="gate", fn=functools.partial(_place_of, ahead))


def _edges(name: str, ahead: int) -> Term:
    quantity = f"own position beyond the sides, and beyond top or bottom, of the opening of {_which(ahead)}"
    return Term(f"{name}_edges", 2, quantity, "m", frame="gate", fn=functools.partial(_beyond, ahead))


def _which(ahead: int) -> str:
    return "the gate passed last" if ahead == LAST else "this gate"


def _opponent(place: int, notice: float) -> tuple[Term, ...]:
    name, near = f"opponent_{place}", "1 / (0.3 m + its distance); 0 where there is none"
    where, closing, nearness = (functools.partial(fn, place) for fn in (_its_place, _its_opening, _its_nearness))
    terms = (
        Term(f"{name}_place", 3, "its position, as `gate_1_place`", "m", PLACE_RANGE, frame="gate", fn=where),
        Term(f"{name}_opening", 1, "how fast its distance grows", "m/s", CLOSING, frame="body", fn=closing),
        Term(f"{name}_nearness", 1, near, "1/m", frame="body", low=0.0, fn=nearness),
    )
    return fading(terms, place, notice)


def _direction(ahead: int, view: View) -> Float[Array, "3 N *B"]:
    offset = view.gate_w(ahead) - view.position_w
    return view.to_body(offset) / jnp.maximum(norm(offset), 0.1)


def _facing(ahead: int, view: View) -> Float[Array, "3 N *B"]:
    return view.to_body(view.gate_forward_w(ahead))


def _place_of(ahead: int, view: View) -> Float[Array, "3 N *B"]:
    return view.shared(_in_gate_frame, ahead)


def _in_gate_frame(view: View, ahead: int) -> Float[Array, "3 N *B"]:
    return view.to_gate_frame(view.position_w - view.gate_w(ahead), ahead)


def _beyond(ahead: int, view: View) -> Float[Array, "2 N *B"]:
    return jnp.abs(view.shared(_in_gate_frame, ahead)[1:]) - view.gate(ahead).half_size


def _motion_at_gate(view: View) -> Float[Array, "3 N *B"]:
    return view.to_gate_frame(view.velocity_w)


def _nearness(view: View) -> Float[Array, "N *B"]:
    return 1 / (NEAR_GATE + norm(view.gate_w() - view.position_w))


def _its_place(place: int, view: View) -> Float[Array, "3 N *B"]:
    one = view.nearest(place)
    return jnp.where(one.present, view.to_gate_frame(view.position_w + one.offset_w - view.gate_w()), 0.0)


def _its_opening(place: int, view: View) -> Float[Array, "N *B"]:
    one = view.nearest(place)
    return jnp.where(one.present, dot(one.offset_w, one.motion_w) / jnp.maximum(one.separation, 0.1), 0.0)


def _its_nearness(place: int, view: View) -> Float[Array, "N *B"]:
    one = view.nearest(place)
    return jnp.where(one.present, 1 / (NEAR_DRONE + one.separation), 0.0)


RACING, RACING_NEAR, RACING_FAR = (
    Observation(name, functools.partial(racing_terms, gates=gates, notice=notice), about=about)
    for name, gates, notice, about in (
        (
            "racing",
            GATES_AHEAD,
            math.inf,
            "As `body`, and where drone and opponents are as the gates see them: for any track and field.",
        ),
        ("racing-near", GATES_AHEAD, NOTICE["body-near"], "As `racing`, but who is far away is not seen."),
        (
            "racing-far",
            GATES_FAR_AHEAD,
            math.inf,
            "As `racing`, with four gates ahead: for value networks, which judge what comes later.",
        ),
    )
)
