"""What a drone sees from its own seat: gates, motion and the nearest opponents in the frame of its body.

Everything is along the body's axes (forward, left, up), so that it looks the same wherever the drone flies and
whichever way it faces. Of opponents the three nearest are seen; zeros where there are fewer. So the size, 52 + K with
K numbers of what the vehicle feels of itself, depends neither on the number of drones nor on their order, and one
policy can race in fields of any size. Clipped to [-3, 3].
"""

import dataclasses
import functools
import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.env.observation_extended import noticed
from cruise.env.view import View
from cruise.terms import Observation, Setting, Term

HEIGHT_RANGE, OPPONENT_RANGE = 4.0, 5.0  # scales [m]
NEAREST = 3  # opponents that are seen
NOTICE = {"body": math.inf, "body-near": 6.0}  # by name: farther away nobody is seen, within half of it all of him [m]
GATES_AHEAD, GATES_FAR_AHEAD = 2, 4


class Ranges(NamedTuple):
    """Scales of what is seen: those of a small room tell centimetres apart."""

    corner: float = 10.0  # [m]
    speed: float = 10.0  # [m/s]


OUTDOORS, ROOM = Ranges(), Ranges(2.0, 3.0)
_term = functools.partial(Term, frame="body")


def body_terms(
    setting: Setting, notice: float = math.inf, gates: int = GATES_AHEAD, ranges: Ranges = OUTDOORS
) -> tuple[Term, ...]:
    """In the order of the vector.

    With `notice` [m], opponents fade out with distance and are gone there: who leads by as much flies as if alone.
    """
    return (
        *(_corner(ahead, corner, ranges.corner) for ahead in range(gates) for corner in range(len(CORNERS))),
        _term("velocity", 3, "own velocity", "m/s", ranges.speed, fn=lambda view: view.to_body(view.velocity_w)),
        _term("up", 3, "the world's up", fn=lambda view: view.rotation[2]),
        *(_felt(felt) for felt in setting.dynamics.internal),
        _term("height", 1, "above the ground", "m", HEIGHT_RANGE, fn=lambda view: view.position_w[2]),
        *(term for place in range(1, NEAREST + 1) for term in _opponent(place, notice)),
    )


CORNERS = ("upper_left", "lower_left", "lower_right", "upper_right")  # as `View.gate_corners_b`


def _corner(ahead: int, corner: int, scale: float) -> Term:
    name, quantity = f"gate_{ahead + 1}_{CORNERS[corner]}", "from the drone to this corner of the opening"
    return _term(name, 3, quantity, "m", scale, fn=lambda view: view.gate_corners_b(ahead)[corner])


def _felt(felt: Term) -> Term:
    return dataclasses.replace(felt, fn=lambda view: felt.fn(view.drones))


def _opponent(place: int, notice: float) -> tuple[Term, ...]:
    fades = f"; all of it fades from whole at {notice / 2:g} m to nothing at {notice:g} m"
    offset = "position minus own, the nearest first" + (fades if math.isfinite(notice) else "")
    name = f"opponent_{place}"
    terms = (
        _term(f"{name}_offset", 3, offset, "m", OPPONENT_RANGE, fn=functools.partial(_offset, place)),
        _term(f"{name}_motion", 3, "velocity minus own", "m/s", OUTDOORS.speed, fn=functools.partial(_motion, place)),
        _term(f"{name}_present", 1, PRESENT, low=0.0, fn=functools.partial(_present, place)),
    )
    return fading(terms, place, notice)


PRESENT = "1; 0, as all of it, where there is none"


def fading(terms: tuple[Term, ...], place: int, notice: float) -> tuple[Term, ...]:
    """The terms of an opponent, less and less from half the distance `notice` on, nothing beyond it."""
    return terms if math.isinf(notice) else tuple(_fading(term, place, notice) for term in terms)


def _fading(term: Term, place: int, notice: float) -> Term:
    return dataclasses.replace(term, fn=lambda view: noticed(view.nearest(place).separation, notice) * term.fn(view))


def _offset(place: int, view: View) -> Float[Array, "3 N *B"]:
    return view.nearest_b(place)[0]


def _motion(place: int, view: View) -> Float[Array, "3 N *B"]:
    return view.nearest_b(place)[1]


def _present(place: int, view: View) -> Float[Array, "N *B"]:
    return view.nearest(place).present.astype(jnp.float32)


BODY, BODY_NEAR = (
    Observation(name, functools.partial(body_terms, notice=notice), about=about)
    for (name, notice), about in zip(
        NOTICE.items(),
        (
            "From the drone's own seat, the same numbers for any number of drones.",
            "As `body`, but who is far away is not seen.",
        ),
        strict=True,
    )
)

PLACE_RANGE, POLE_RANGE = 3.0, 2.0  # [m]
POLES = 4  # of a track that are seen, in its order


def _heading(view: View) -> Float[Array, "2 N *B"]:
    return jnp.stack([jnp.cos(view.euler[2]), jnp.sin(view.euler[2])])


def _pole(number: int) -> Term:
    quantity = f"from the drone to the axis of pole {number + 1} of the track, level; 0 where it has no such pole"
    return Term(f"pole_{number + 1}", 2, quantity, "m", POLE_RANGE, fn=lambda view: view.to_pole_w(number))


BODY_PLACED = Observation("body-placed", functools.partial(body_terms, ranges=ROOM)).with_terms(
    "body-placed",
    Term("place", 3, "own position", "m", PLACE_RANGE, fn=lambda view: view.position_w),
    Term("heading", 2, "cosine and sine of the own yaw", fn=_heading),
    *(_pole(number) for number in range(POLES)),
    about="As `body` with finer scales, with its place in the world and poles: for one small track.",
)
BODY_FAR = Observation(
    "body-far",
    functools.partial(body_terms, gates=GATES_FAR_AHEAD),
    about="As `body`, with four gates ahead: for value networks, which judge what comes later.",
)
