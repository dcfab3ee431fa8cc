"""Frames and what a straight flight meets, in plain arithmetic that NumPy, JAX and CasADi share.

A vector is three components: a tuple of numbers or arrays, or an array whose leading axis holds them. Everything else
broadcasts. A gate's frame is (forward along its normal, left, up); its axes are the columns of Rz(yaw) Ry(pitch)
Rx(roll). A flight of one step goes straight from `start` to `end`; where it meets something is a fraction of the step,
from 0 to 1, and `NEVER` where it does not.
"""

import functools
import math
import sys
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np

NEVER = 2.0  # a fraction of a step that is beyond its end
TINY = 1e-9  # what moves less than this within a step stands still [m]

Number = Any  # a float, or an array of NumPy, JAX or CasADi
Vector = Any  # three of them
Heading = Any  # (cos yaw, sin yaw)
Tilt = Any  # (cos pitch, sin pitch, cos roll, sin roll); None: upright


def heading_of(yaw: float) -> tuple[float, float]:
    """(cos yaw, sin yaw)."""
    return math.cos(yaw), math.sin(yaw)


def tilt_of(roll: float, pitch: float) -> tuple[float, float, float, float] | None:
    """The tilt of a gate; None for one that stands upright."""
    if roll == 0 and pitch == 0:
        return None
    return math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)


def to_gate(heading: Heading, vector_w: Vector, tilt: Tilt = None) -> tuple[Number, Number, Number]:
    """A world vector along (forward, left, up) of a gate; the inverse of `from_gate`."""
    (cos_yaw, sin_yaw), (x, y, up) = _parts(heading, 2), _parts(vector_w, 3)
    forward, left = cos_yaw * x + sin_yaw * y, cos_yaw * y - sin_yaw * x
    if tilt is None:
        return forward, left, up
    cos_pitch, sin_pitch, cos_roll, sin_roll = _parts(tilt, 4)
    forward, up = cos_pitch * forward - sin_pitch * up, sin_pitch * forward + cos_pitch * up
    return forward, cos_roll * left + sin_roll * up, cos_roll * up - sin_roll * left


def from_gate(heading: Heading, vector: Vector, tilt: Tilt = None) -> tuple[Number, Number, Number]:
    """A vector along (forward, left, up) of a gate in the world."""
    (cos_yaw, sin_yaw), (forward, left, up) = _parts(heading, 2), _parts(vector, 3)
    if tilt is not None:
        cos_pitch, sin_pitch, cos_roll, sin_roll = _parts(tilt, 4)
        left, up = cos_roll * left - sin_roll * up, sin_roll * left + cos_roll * up
        forward, up = cos_pitch * forward + sin_pitch * up, cos_pitch * up - sin_pitch * forward
    return cos_yaw * forward - sin_yaw * left, sin_yaw * forward + cos_yaw * left, up


def beyond_opening(left: Number, up: Number, half_width: Number, half_height: Number, is_round: Any = None) -> Number:
    """How far a point of a gate's plane lies beyond the edge of the opening, negative inside [m].

    Around an upright rectangle that is measured as a frame is, square corners included; around a round opening, whose
    diameter is its width, from the circle. `is_round` None: a rectangle.
    """
    xp = functions(left, up, half_width)
    square = xp.maximum(xp.abs(left) - half_width, xp.abs(up) - half_height)
    if is_round is None:
        return square
    return xp.where(is_round, xp.sqrt(left * left + up * up) - half_width, square)


def plane_fraction(before: Number, after: Number) -> Number:
    """Fraction of the step at which a signed distance from a plane is 0; clipped where it never is."""
    xp = functions(before, after)
    length = after - before
    return xp.minimum(xp.maximum(-before / xp.where(length == 0, 1.0, length), 0.0), 1.0)


def fall_below(before: Number, after: Number) -> Number:
    """Fraction of the step at which a height that ends at 0 or lower is 0."""
    xp = functions(before, after)
    fraction = xp.maximum(before, 0.0) / xp.maximum(before - after, TINY)
    return xp.where(after <= 0, xp.minimum(fraction, 1.0), NEVER)


def meet_cylinder(start: Vector, end: Vector, radius: Number, height: Number) -> Number:
    """First contact with an upright cylinder whose foot's middle is the origin."""
    (x, y, z), (x1, y1, z1) = _parts(start, 3), _parts(end, 3)
    xp = functions(x, x1, radius)
    dx, dy = x1 - x, y1 - y
    length2, along, across = dx * dx + dy * dy, x * dx + y * dy, x * dy - y * dx
    still = length2 < TINY * TINY
    # where it stands still in the plane it is inside all the time or never
    chord2 = xp.where(still, radius * radius - (x * x + y * y), radius * radius * length2 - across * across)
    length2 = xp.maximum(length2, TINY * TINY)
    half = xp.sqrt(xp.maximum(chord2, 0.0))
    enter, leave = _slab(z - height / 2, z1 - z, height / 2)
    enter = xp.maximum(enter, (-along - half) / length2)
    leave = xp.minimum(leave, (half - along) / length2)
    return _first(enter, xp.where(chord2 >= 0, leave, -1.0))


def meet_box(start: Vector, end: Vector, half_size: Vector) -> Number:
    """First contact with a box about the origin, its faces along the axes."""
    xp = functions(*_parts(start, 3), *_parts(end, 3))
    slabs = [_slab(a, b - a, h) for a, b, h in zip(*(_parts(v, 3) for v in (start, end, half_size)), strict=True)]
    (enter, leave), *others = slabs
    for one, other in others:
        enter, leave = xp.maximum(enter, one), xp.minimum(leave, other)
    return _first(enter, leave)


def leave_above(before: Number, after: Number, limit: Number) -> Number:
    """Fraction of the step at which a coordinate that ends above `limit` passes it."""
    xp = functions(before, after, limit)
    fraction = (limit - before) / xp.maximum(after - before, TINY)
    return xp.where(after > limit, xp.minimum(xp.maximum(fraction, 0.0), 1.0), NEVER)


def nearest_fraction(offset: Vector, motion: Vector) -> Number:
    """Fraction of the step at which a point that moves from `offset` by `motion` is nearest to the origin."""
    (x, y, z), (dx, dy, dz) = _parts(offset, 3), _parts(motion, 3)
    xp = functions(x, dx)
    motion2 = xp.maximum(dx * dx + dy * dy + dz * dz, 1e-12)
    return xp.minimum(xp.maximum(-(x * dx + y * dy + z * dz) / motion2, 0.0), 1.0)


def distance2_at(offset: Vector, motion: Vector, fraction: Number) -> Number:
    """Squared distance from the origin of a point that has moved from `offset` by a fraction of `motion`."""
    x, y, z = (a + fraction * da for a, da in zip(_parts(offset, 3), _parts(motion, 3), strict=True))
    return x * x + y * y + z * z


def meet_sphere(offset: Vector, motion: Vector, radius: Number) -> Number:
    """First contact of a point that moves from `offset` by `motion` with a sphere about the origin."""
    (x, y, z), (dx, dy, dz) = _parts(offset, 3), _parts(motion, 3)
    fraction = nearest_fraction(offset, motion)
    xp = functions(fraction, radius)
    motion2 = dx * dx + dy * dy + dz * dz
    slope = x * dx + y * dy + z * dz + fraction * motion2  # 0 unless the nearest point is an end of the step
    inside2 = radius * radius - distance2_at(offset, motion, fraction)
    root = xp.sqrt(xp.maximum(slope * slope + motion2 * inside2, 0.0))
    contact = fraction - (slope + root) / xp.maximum(motion2, 1e-12)
    return xp.where(inside2 > 0, xp.minimum(xp.maximum(contact, 0.0), 1.0), NEVER)


def to_body(rotation: Any, vector_w: Vector) -> tuple[Number, Number, Number]:
    """R^T v: a world vector along the body's axes, which are the columns of `rotation`."""
    x, y, z = _parts(vector_w, 3)
    a, b, c = (rotation[0, k] * x + rotation[1, k] * y + rotation[2, k] * z for k in range(3))
    return a, b, c


def from_body(rotation: Any, vector: Vector) -> tuple[Number, Number, Number]:
    """R v: a vector along the body's axes in the world."""
    x, y, z = _parts(vector, 3)
    a, b, c = (rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z for k in range(3))
    return a, b, c


def functions(*values: Any) -> Any:
    """The module whose `where`, `minimum`, `maximum`, `abs` and `sqrt` take these values: NumPy's where all are plain.

    CasADi's where one of them is a symbol, JAX's where one is a JAX array.
    """
    for value in values:
        if type(value).__module__.startswith("casadi"):
            return _casadi()
        if type(value).__module__.startswith("jax"):
            return sys.modules["jax.numpy"]
    return np


@functools.cache
def _casadi() -> SimpleNamespace:
    """CasADi's functions under NumPy's names."""
    casadi = sys.modules["casadi"]
    return SimpleNamespace(
        abs=casadi.fabs, sqrt=casadi.sqrt, maximum=casadi.fmax, minimum=casadi.fmin, where=casadi.if_else
    )


def _parts(vector: Any, count: int) -> Iterable[Any]:
    """Components of a vector."""
    return vector if isinstance(vector, tuple | list) else [vector[i] for i in range(count)]


def _slab(place: Number, motion: Number, half: Number) -> tuple[Number, Number]:
    """Fractions between which a coordinate lies within +-half."""
    xp = functions(place, motion, half)
    still = xp.abs(motion) < TINY
    inverse = 1 / xp.where(still, TINY, motion)
    low, high = (-half - place) * inverse, (half - place) * inverse
    return xp.minimum(low, high), xp.maximum(low, high)


def _first(enter: Number, leave: Number) -> Number:
    """First fraction of the step within an interval."""
    xp = functions(enter, leave)
    margin = xp.minimum(xp.minimum(leave - enter, leave), 1 - enter)
    return xp.where(margin >= 0, xp.maximum(enter, 0.0), NEVER)
