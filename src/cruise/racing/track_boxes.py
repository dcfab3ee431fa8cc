"""What of a track shares room: gates and solids as boxes, by separating axes. Plain Python: no JAX."""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

from cruise import geometry
from cruise.config import Gate, Vec3
from cruise.racing.solids import Outline

MIN_DEPTH = 0.1  # a gate takes at least this much room along its normal [m]
TOUCH = 1e-6  # what shares no more than this only touches [m]


class Box(NamedTuple):
    """A box in any attitude."""

    centre_w: Vec3  # [m]
    axes: tuple[Vec3, Vec3, Vec3]  # unit vectors
    half_size: Vec3  # along them [m]

    @property
    def reach(self) -> Vec3:
        """Half extents along the world's axes [m]."""
        x, y, z = (
            sum(abs(axis[i]) * half for axis, half in zip(self.axes, self.half_size, strict=True)) for i in range(3)
        )
        return x, y, z


def gate_axes(gate: Gate) -> tuple[Vec3, Vec3, Vec3]:
    """Unit vectors forward, left and up of a gate."""
    heading, tilt = geometry.heading_of(gate.yaw), geometry.tilt_of(gate.roll, gate.pitch)
    forward, left, up = (geometry.from_gate(heading, one, tilt) for one in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    return forward, left, up


def opening_box(gate: Gate, depth: float = MIN_DEPTH, border: float = 0.0) -> Box:
    """An opening, widened by a border on every side; a round one as its square."""
    height = gate.width if gate.shape == "round" else gate.height
    half = depth / 2, gate.width / 2 + border, height / 2 + border
    return Box(gate.position_w, gate_axes(gate), half)


def frame_boxes(gate: Gate, frame_width: float) -> Iterator[Box]:
    """The four bars around an opening."""
    if frame_width == 0:
        return
    whole = opening_box(gate, max(frame_width, MIN_DEPTH), frame_width)
    depth, width, height = whole.half_size
    bar = frame_width / 2
    bars = [((0.0, side * (width - bar), 0.0), (depth, bar, height)) for side in (-1, 1)]
    bars += [((0.0, 0.0, side * (height - bar)), (depth, width, bar)) for side in (-1, 1)]
    for offset, half in bars:
        x, y, z = (
            c + sum(o * axis[i] for o, axis in zip(offset, whole.axes, strict=True))
            for i, c in enumerate(gate.position_w)
        )
        yield Box((x, y, z), whole.axes, half)


def outline_box(outline: Outline) -> Box:
    """The upright box around a solid."""
    cos, sin = geometry.heading_of(outline.yaw)
    length, width, height = outline.size
    axes = (cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)
    return Box(outline.centre_w, axes, (length / 2, width / 2, height / 2))


def share_room(a: Box, b: Box) -> bool:
    """Whether two boxes overlap by more than a touch (Gottschalk et al., OBBTree, 1996)."""
    offset = _minus(b.centre_w, a.centre_w)
    if _norm(offset) >= _norm(a.half_size) + _norm(b.half_size):
        return False
    crosses = (_cross(p, q) for p, q in itertools.product(a.axes, b.axes))
    for axis in (*a.axes, *b.axes, *crosses):
        length = _norm(axis)
        if length < 1e-6:
            continue
        reach = sum(
            half * abs(_dot(axis, one)) for box in (a, b) for half, one in zip(box.half_size, box.axes, strict=True)
        )
        if abs(_dot(axis, offset)) >= reach - TOUCH * length:
            return False
    return True


def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vec3, b: Vec3) -> Vec3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _minus(a: Vec3, b: Vec3) -> Vec3:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _norm(a: Vec3) -> float:
    return math.sqrt(_dot(a, a))
