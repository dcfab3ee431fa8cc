"""Smooth ways from one gate to the next, tangent to both normals, around solids. NumPy: computed once per track."""

import functools
import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cruise import geometry
from cruise.config import Gate, Track
from cruise.racing.detours import Site, site_of, via_points

SAMPLES = 800  # of every way, where nobody asks for fewer
STRETCH = np.linspace(0.9, 1.5, 13)  # lengths of a spline's end tangents that are tried, over the straight distance
SHARPEST = 1.0  # a spline that bends more than this is a hairpin, flown as arcs and a straight [1/m]
STEEPEST = 1.0  # a way climbs or sinks at most this much per metre flown horizontally
SHORTEST = 0.1  # a way back to the same gate is a circle [m]
TURN_RADIUS = 3.0  # of those arcs, at least [m]
ROOM = 2.0  # between the frame of a gate and a drone that returns beside it [m]


class Way(NamedTuple):
    """A curve sampled from one gate to the next, both included; or several at once, along leading axes."""

    point_w: np.ndarray  # [... P, 3] m
    tangent_w: np.ndarray  # [... P, 3] unit vectors

    @property
    def steps(self) -> np.ndarray:
        """[... P - 1] lengths between samples [m]."""
        return np.linalg.norm(np.diff(self.point_w, axis=-2), axis=-1)

    @property
    def curvature(self) -> np.ndarray:
        """[... P] by differences of the tangent, so that a reversal on the spot is as sharp as it is [1/m]."""
        turned = np.linalg.norm(np.diff(self.tangent_w, axis=-2), axis=-1)
        bend = turned / np.maximum(self.steps, 1e-9)
        return np.concatenate([bend, bend[..., -1:]], axis=-1)


def ways(track: Track) -> list[Way]:
    """From every gate to the next, the last one back to the first; around poles and walls where that can be."""
    gates, site = track.gates, site_of(track)
    return [way_around(site, a, b, track.frame_width) for a, b in zip(gates, gates[1:] + gates[:1], strict=True)]


def way_around(site: Site, a: Gate, b: Gate, frame_width: float) -> Way:
    """The way between two gates, by places beside solids where it would come too near to one.

    Where no way is clear it is the one that knows of no solids.
    """
    connect = functools.cache(functools.partial(way_between, frame_width=frame_width))
    vias = via_points(site, a, b, lambda p, q: connect(p, q).point_w)
    parts = [connect(p, q) for p, q in itertools.pairwise((a, *(vias or ()), b))]
    return Way(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))


def way_between(a: Gate, b: Gate, frame_width: float, samples: int = SAMPLES) -> Way:
    """A cubic spline where it bends little enough, else arcs and a straight; a spline through gates that pitch."""
    spline = bent_least(a, b, samples)
    if spline is not None:
        return spline
    width = max(a.width, b.width) / 2 + frame_width
    return turning_way(a, b, max(TURN_RADIUS, (width + ROOM) / 2), samples)


def bent_least(a: Gate, b: Gate, samples: int = SAMPLES) -> Way | None:
    """The cubic Hermite spline of least bending energy; None where every one of them is sharp or steep."""
    if a.position_w == b.position_w:
        return None
    splines = hermite(a, b, STRETCH, samples)
    bent = splines.curvature.max(axis=-1) <= SHARPEST
    tilted = bool(a.pitch or b.pitch)  # is flown through along its normal, however steep that is
    flyable = bent | (not bent.any()) if tilted else bent & (_slope(splines) <= STEEPEST)
    if not flyable.any():
        return None
    least = int(np.where(flyable, _bending_energy(splines), np.inf).argmin())
    return Way(splines.point_w[least], splines.tangent_w[least])


def hermite(a: Gate, b: Gate, stretch: np.ndarray, samples: int = SAMPLES) -> Way:
    """Cubic Hermite splines whose end tangents are the normals times each `stretch` times the straight distance."""
    p0, p1 = np.array(a.position_w), np.array(b.position_w)
    pull = stretch[:, None, None] * math.dist(a.position_w, b.position_w)
    m0, m1 = pull * normal_of(a), pull * normal_of(b)
    u = np.linspace(0.0, 1.0, samples)[:, None]
    point = (2 * u**3 - 3 * u**2 + 1) * p0 + (u**3 - 2 * u**2 + u) * m0
    point = point + (3 * u**2 - 2 * u**3) * p1 + (u**3 - u**2) * m1
    first = 6 * (u**2 - u) * (p0 - p1) + (3 * u**2 - 4 * u + 1) * m0 + (3 * u**2 - 2 * u) * m1
    return Way(point, first / np.maximum(np.linalg.norm(first, axis=-1, keepdims=True), 1e-9))


def turning_way(a: Gate, b: Gate, radius: float, samples: int = SAMPLES) -> Way:
    """The shortest way of two arcs of `radius` and a straight (Dubins, 1957) that is long enough not to be steep.

    It climbs or sinks smoothly, level at both gates.
    """
    rise = b.position_w[2] - a.position_w[2]
    least = max(1.5 * abs(rise) / STEEPEST, SHORTEST)  # a smooth step is half as steep again in its middle
    turns = min((t for t in _turns(a, b, radius) if sum(t.lengths) >= least), key=lambda t: sum(t.lengths))
    s = np.linspace(0.0, sum(turns.lengths), samples)
    x, y, heading = _follow(a, turns, radius, s)
    u = s / s[-1]
    z = a.position_w[2] + rise * (3 * u**2 - 2 * u**3)
    slope = rise * 6 * (u - u**2) / s[-1]
    tangent = np.stack([np.cos(heading), np.sin(heading), slope], axis=1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return Way(np.stack([x, y, z], axis=1), tangent)


class _Turns(NamedTuple):
    """Arc, straight, arc."""

    signs: tuple[int, int, int]  # 1 left, 0 straight, -1 right
    lengths: tuple[float, float, float]  # [m]


def _turns(a: Gate, b: Gate, radius: float) -> Iterator[_Turns]:
    """Ways with either sense of either arc, and with up to some full circles flown first."""
    for first in (1, -1):
        for last in (1, -1):
            found = _tangent_turns(a, b, radius, first, last)
            if found is None:
                continue
            rise = abs(b.position_w[2] - a.position_w[2])
            for circles in range(math.ceil(rise / STEEPEST / radius) + 2):
                yield _Turns((first, 0, last), (found[0] + 2 * math.pi * radius * circles, *found[1:]))


def _tangent_turns(a: Gate, b: Gate, radius: float, first: int, last: int) -> tuple[float, float, float] | None:
    """Lengths of arc, straight and arc; None where circles that turn in opposite senses overlap."""
    side_a, side_b = a.yaw + first * math.pi / 2, b.yaw + last * math.pi / 2
    ax, ay = a.position_w[0] + radius * math.cos(side_a), a.position_w[1] + radius * math.sin(side_a)
    bx, by = b.position_w[0] + radius * math.cos(side_b), b.position_w[1] + radius * math.sin(side_b)
    apart, along = math.hypot(bx - ax, by - ay), math.atan2(by - ay, bx - ax)
    across = 0.0 if first == last else 2 * radius
    if apart < across:
        return None
    heading = along + (first * math.asin(across / apart) if across else 0.0)
    turn_a = (first * (heading - a.yaw)) % (2 * math.pi)
    turn_b = (last * (b.yaw - heading)) % (2 * math.pi)
    return radius * _not_full(turn_a), math.sqrt(apart**2 - across**2), radius * _not_full(turn_b)


def _not_full(turn: float) -> float:
    """No turn at all in place of a full circle that rounding makes of it."""
    return 0.0 if 2 * math.pi - turn < 1e-9 else turn


def _follow(a: Gate, turns: _Turns, radius: float, s: np.ndarray) -> tuple[np.ndarray, ...]:
    """Position and heading after `s` [m]."""
    x, y = np.full(len(s), a.position_w[0]), np.full(len(s), a.position_w[1])
    heading = np.full(len(s), a.yaw)
    begin = 0.0
    for sign, length in zip(turns.signs, turns.lengths, strict=True):
        if length == 0.0:
            continue
        flown = np.clip(s - begin, 0.0, length)
        turned = heading + sign * flown / radius
        if sign:
            x = x + sign * radius * (np.sin(turned) - np.sin(heading))
            y = y - sign * radius * (np.cos(turned) - np.cos(heading))
        else:
            x, y = x + flown * np.cos(heading), y + flown * np.sin(heading)
        heading = turned
        begin += length
    return x, y, heading


def normal_of(gate: Gate) -> np.ndarray:
    """The direction [3] in which a gate is flown."""
    tilt = geometry.tilt_of(gate.roll, gate.pitch)
    return np.array(geometry.from_gate(geometry.heading_of(gate.yaw), (1.0, 0.0, 0.0), tilt))


def _slope(way: Way) -> np.ndarray:
    """Steepest climb per metre flown horizontally."""
    level = np.linalg.norm(way.tangent_w[..., :2], axis=-1)
    return (np.abs(way.tangent_w[..., 2]) / np.maximum(level, 1e-9)).max(axis=-1)


def _bending_energy(way: Way) -> np.ndarray:
    """Integral of the squared curvature [1/m]."""
    return (way.curvature[..., :-1] ** 2 * way.steps).sum(axis=-1)
