"""Lengths of a track, and the ways in which its gates can stand wrongly. Plain Python: no JAX."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from cruise.config import Gate, Vec3
from cruise.racing.solids import Outline
from cruise.racing.track_boxes import MIN_DEPTH, TOUCH, Box, frame_boxes, opening_box, outline_box, share_room

# In single precision, 0.03 mm is told apart at this distance: a drone at 0.1 m/s moves 0.2 mm in a step of 2 ms.
FARTHEST = 500.0  # of gates from the origin, along every axis [m]
WAY_SAMPLES = 32
ACROSS, BACKWARDS = math.radians(90), math.radians(135)  # of a gate's normal to the flight through it

Gates = Mapping[int, Gate]  # by number in the order of flight, 0 first


def segment_lengths(gates: Sequence[Gate]) -> list[float]:
    """Straight-line distance [m] from each gate to the next, the last one back to the first."""
    positions = [gate.position_w for gate in gates]
    return [math.dist(a, b) for a, b in zip(positions, positions[1:] + positions[:1], strict=True)]


def lap_length(gates: Sequence[Gate]) -> float:
    """Length [m] of the closed polygon through the gates' centres."""
    return math.fsum(segment_lengths(gates))


def box_around(gates: Iterable[Gate], margin: float) -> tuple[Vec3, Vec3]:
    """Lowest and highest corner of a box on the ground, `margin` [m] wider and higher than the openings."""
    corners = [[(p - r, p + r) for p, r in zip(gate.position_w, _reach(gate), strict=True)] for gate in gates]
    axes = zip(*corners, strict=True)
    (x0, x1), (y0, y1), (_, z1) = ((min(a for a, _ in axis), max(b for _, b in axis)) for axis in axes)
    return (x0 - margin, y0 - margin, 0.0), (x1 + margin, y1 + margin, z1 + margin)


def overlaps(gates: Gates, count: int, frame_width: float) -> Iterator[str]:
    """Gates, of `count` in all, whose openings share room, or one's opening with the other's frame.

    But for one that is flown twice a lap. Nobody flies a gate twice in succession: two of one place that follow each
    other are a slip of the pen.
    """
    for (i, a), (j, b) in _pairs(gates, count, frame_width):
        apart = f"their centres are {math.dist(a.position_w, b.position_w):.3g} m apart"
        if share_room(opening_box(a), opening_box(b)):
            yield f"{gate_place(i)}: overlaps gate {j + 1}: their openings share room, {apart}"
        elif any(_bar_in_opening(*pair, frame_width) for pair in ((a, b), (b, a))):
            yield f"{gate_place(i)}: overlaps gate {j + 1}: the frame of one stands in the other's opening, {apart}"


def touching_frames(gates: Gates, count: int, frame_width: float) -> Iterator[str]:
    """Gates of which only the frames share room: worth a word, no fault."""
    for (i, a), (j, b) in _pairs(gates, count, frame_width):
        openings = share_room(opening_box(a), opening_box(b))
        if not openings and not any(_bar_in_opening(*pair, frame_width) for pair in ((a, b), (b, a))):
            yield f"{gate_place(i)}: its frame overlaps that of gate {j + 1}, openings apart"


def _pairs(gates: Gates, count: int, frame_width: float) -> Iterator[tuple[tuple[int, Gate], tuple[int, Gate]]]:
    """Pairs of gates that share room, frames included, and are not one flown twice."""
    depth = max(frame_width, MIN_DEPTH)
    boxes = {i: opening_box(gate, depth, frame_width) for i, gate in gates.items()}
    for (i, a), (j, b) in itertools.combinations(gates.items(), 2):
        twice = _same(a, b) and (j - i) % count not in (1, count - 1)
        if not twice and share_room(boxes[i], boxes[j]):
            yield (i, a), (j, b)


def _bar_in_opening(a: Gate, b: Gate, frame_width: float) -> bool:
    """Whether the frame of a stands in the opening of b."""
    return any(share_room(bar, opening_box(b)) for bar in frame_boxes(a, frame_width))


def obstructions(gates: Gates, solids: Sequence[tuple[str, Outline]], low: Vec3, high: Vec3) -> Iterator[str]:
    """Named solids in an opening, under ground or out of bounds."""
    for name, solid in solids:
        box, place = outline_box(solid), solid.centre_w
        if place[2] + box.half_size[2] <= 0:
            yield f"{name}: lies under ground: its top is at z = {place[2] + box.half_size[2]:.4g}, must be above 0"
        if not all(a - TOUCH <= p <= b + TOUCH for a, p, b in zip(low[:2], place[:2], high[:2], strict=True)):
            yield f"{name}: is out of bounds: stands at ({place[0]:.4g}, {place[1]:.4g})"
        yield from (f"{name}: stands in the opening of gate {i + 1}" for i in gates if _stands_in(box, gates[i]))


def _stands_in(box: Box, gate: Gate) -> bool:
    return share_room(box, opening_box(gate))


def far_away(gates: Gates) -> Iterator[str]:
    """Gates so far from the origin that in single precision a slow drone could not move there."""
    for i, gate in gates.items():
        farthest = max(gate.position_w, key=abs)
        if abs(farthest) > FARTHEST:
            yield (
                f"{gate_place(i)}: is too far from the origin: at {farthest:.6g} m, at most {FARTHEST:g} m: "
                "move the track's middle there"
            )


def facing_away(gates: Gates, count: int, beyond: float = BACKWARDS) -> Iterator[str]:
    """Gates whose normal is more than `beyond` [rad] off the bisector of the way in and the way out.

    Of `count` gates only those in `gates` are known; a gate is judged when both its neighbours are. Where the bisector
    vanishes (one gate, two gates, a hairpin) either face will do.
    """
    for i, gate in gates.items():
        before, after = gates.get((i - 1) % count), gates.get((i + 1) % count)
        if before is None or after is None:
            continue
        heading = _flight_heading(before.position_w, gate.position_w, after.position_w)
        faces = gate.yaw + (math.pi if math.cos(gate.pitch) < 0 else 0.0)
        if (
            heading is not None
            and abs(math.cos(gate.pitch)) > 1e-6
            and math.cos(heading - faces) < math.cos(beyond) - 1e-6
        ):
            yaw, flight = math.degrees(gate.yaw), math.degrees(heading)
            yield f"{gate_place(i)}: faces away from the flight direction: yaw_deg is {yaw:.4g}, flown at {flight:.4g}"


def misplaced(gates: Gates, low: Vec3, high: Vec3) -> Iterator[str]:
    """Gates under ground or beyond the bounds. The part of an opening below ground is just not flown through."""
    for i, gate in gates.items():
        if gate.position_w[2] <= 0:
            yield f"{gate_place(i)}: lies under ground: its centre is at z = {gate.position_w[2]:.4g}, must be above 0"
        for axis, (name, centre, reach) in enumerate(zip("xyz", gate.position_w, _reach(gate), strict=True)):
            place = f"{gate_place(i)}: is out of bounds: reaches {name}"
            if axis < 2 and centre - reach < low[axis] - TOUCH:
                yield f"{place} = {centre - reach:.4g}, bounds begin at {low[axis]:.4g}"
            if centre + reach > high[axis] + TOUCH:
                yield f"{place} = {centre + reach:.4g}, bounds end at {high[axis]:.4g}"


def unreachable(gates: Gates, count: int, leave_distance: float) -> Iterator[str]:
    """Gates whose straight way to the next leads farther than `leave_distance` [m] from every gate."""
    centres = [gate.position_w for gate in gates.values()]
    if len(gates) < count:
        return
    for i, gate in gates.items():
        after = (i + 1) % count
        ways = _points_between(gate.position_w, gates[after].position_w)
        farthest = max(min(math.dist(point, centre) for centre in centres) for point in ways)
        if farthest > leave_distance + TOUCH:
            yield (
                f"{gate_place(i)}: the straight way to gate {after + 1} is up to {farthest:.4g} m from every gate, "
                f"beyond leave_distance = {leave_distance:.4g} m"
            )


def gate_place(index: int) -> str:
    """How messages name a gate: numbers begin at 1."""
    return f"gate {index + 1}"


def _points_between(a: Vec3, b: Vec3) -> Iterator[Vec3]:
    for k in range(WAY_SAMPLES + 1):
        x, y, z = (p + (q - p) * k / WAY_SAMPLES for p, q in zip(a, b, strict=True))
        yield x, y, z


def _flight_heading(before: Vec3, here: Vec3, after: Vec3) -> float | None:
    """Heading [rad] of the bisector of the way in and the way out; None where it has no horizontal direction."""
    into, out = math.dist(before, here), math.dist(here, after)
    if into == 0 or out == 0:
        return None
    x, y = ((h - b) / into + (a - h) / out for b, h, a in zip(before[:2], here[:2], after[:2], strict=True))
    return math.atan2(y, x) if math.hypot(x, y) > 1e-6 else None


def _reach(gate: Gate) -> Vec3:
    """Half extents of the opening along the world's axes [m]."""
    return opening_box(gate, depth=0.0).reach


def _same(a: Gate, b: Gate) -> bool:
    """Whether two gates are one, flown along the same heading or the opposite one."""
    turned = abs(math.remainder(a.yaw - b.yaw, math.pi))
    tilt = math.hypot(a.roll - b.roll, a.pitch - b.pitch) < 1e-6
    return (a.position_w, a.width, a.height) == (b.position_w, b.width, b.height) and turned < 1e-6 and tilt
