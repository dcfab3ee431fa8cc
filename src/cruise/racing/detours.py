"""Ways around solids: a way that comes too near to one goes by beside it or over it. Plain NumPy, once per track."""

import itertools
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from cruise.config import Gate, Track, Vec3
from cruise.racing.clearance import clearance
from cruise.racing.solids import Outline, outlines

BERTHS = (1.0, 0.6)  # that ways keep from solids: where there is room, and at least [m]
ROOMS = (1.25, 2.2)  # places to go by lie so many berths from a solid, so that a curve through them keeps one
DEEPEST = 2  # detours within detours
LEAST_HEIGHT = 0.8  # of a place to go by [m]

Points = np.ndarray  # [P, 3] m
Connect = Callable[[Gate, Gate], Points]  # a way that knows of no solid, sampled


class Site(NamedTuple):
    """What a way must keep clear of, and within."""

    solids: tuple[Outline, ...]
    low: Vec3
    high: Vec3
    berth: float = BERTHS[0]  # that ways keep from solids [m]


def site_of(track: Track) -> Site:
    """The solids and the box of a track."""
    return Site(tuple(outlines(track.obstacles)), track.bounds_low, track.bounds_high)


def via_points(site: Site, a: Gate, b: Gate, connect: Connect) -> tuple[Gate, ...] | None:
    """Places, as gates without a frame, through which the shortest clear way from a to b leads.

    None of them where the way is clear as it is; None where no clear way was found.
    """
    tries = (_search(site._replace(berth=berth), a, b, connect, DEEPEST) for berth in BERTHS)
    return next((found for found in tries if found is not None), None)


def _search(site: Site, a: Gate, b: Gate, connect: Connect, depth: int) -> tuple[Gate, ...] | None:
    hit = first_hit(site, a, b, connect(a, b))
    if hit is None:
        return ()
    if depth == 0:
        return None
    best: tuple[float, tuple[Gate, ...]] | None = None
    for via in _beside(site, a, b, hit):
        if (
            best is not None
            and math.dist(a.position_w, via.position_w) + math.dist(via.position_w, b.position_w) > best[0]
        ):
            continue
        before = _search(site, a, via, connect, depth - 1)
        after = None if before is None else _search(site, via, b, connect, depth - 1)
        if before is None or after is None:
            continue
        found = (*before, via, *after)
        length = sum(_length(connect(p, q)) for p, q in itertools.pairwise((a, *found, b)))
        if best is None or length < best[0]:
            best = (length, found)
    return None if best is None else best[1]


def first_hit(site: Site, a: Gate, b: Gate, points_w: Points) -> Outline | None:
    """The first solid to which points on the way from a to b come nearer than they must."""
    first: tuple[int, Outline] | None = None
    for solid in site.solids:
        distance = clearance(solid, tuple(points_w.T)).distance
        ends = min(float(clearance(solid, gate.position_w).distance) for gate in (a, b))
        near = np.flatnonzero(distance < min(site.berth, 0.9 * ends))
        if len(near) and (first is None or near[0] < first[0]):
            first = (int(near[0]), solid)
    return None if first is None else first[1]


def _beside(site: Site, a: Gate, b: Gate, solid: Outline) -> Iterator[Gate]:
    """Places to the left and right of a solid and over it, passed in the direction from a to b."""
    x, y = (q - p for p, q in zip(a.position_w[:2], b.position_w[:2], strict=True))
    heading = math.atan2(y, x) if math.hypot(x, y) > site.berth else a.yaw
    ahead, left = (math.cos(heading), math.sin(heading)), (-math.sin(heading), math.cos(heading))
    half = _half_across(solid, left)
    along = sum((c - p) * d for c, p, d in zip(solid.centre_w[:2], a.position_w[:2], ahead, strict=True))
    share = min(max(along / max(math.hypot(x, y), site.berth), 0.0), 1.0)
    level = max(a.position_w[2] + share * (b.position_w[2] - a.position_w[2]), LEAST_HEIGHT)
    over = solid.centre_w[2] + solid.size[2] / 2 + ROOMS[0] * site.berth
    beside = [(sign * (half + room * site.berth), level) for room in ROOMS for sign in (1, -1)]
    for side, height in (*beside, (0.0, max(over, level))):
        place = (solid.centre_w[0] + side * left[0], solid.centre_w[1] + side * left[1], height)
        if all(low < p < high for low, p, high in zip(site.low, place, site.high, strict=True)):
            yield Gate(place, heading, 0.0, 0.0)


def _half_across(solid: Outline, side: tuple[float, float]) -> float:
    """Half the width of a solid as seen along a level direction at right angles to `side` [m]."""
    length, thickness, _ = solid.size
    if solid.shape == "cylinder":
        return length / 2
    cos, sin = math.cos(solid.yaw), math.sin(solid.yaw)
    return abs(cos * side[0] + sin * side[1]) * length / 2 + abs(cos * side[1] - sin * side[0]) * thickness / 2


def _length(points_w: Points) -> float:
    return float(np.linalg.norm(np.diff(points_w, axis=0), axis=1).sum())
