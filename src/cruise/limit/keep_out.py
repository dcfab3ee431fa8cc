"""Poles and walls as inequalities of the optimiser: a line stays a margin away from all of them."""

import casadi as ca
import numpy as np

from cruise.config import Track
from cruise.racing.clearance import clearance
from cruise.racing.solids import outlines

BETWEEN = (0.25, 0.5, 0.75)  # shares of a step at which the line is looked at beside its ends


def distances(track: Track, points_w: ca.MX) -> ca.MX:
    """From every solid to every point [3, P], behind each other [m]."""
    point = ca.SX.sym("p", 3)
    each = [clearance(solid, tuple(ca.vertsplit(point))).distance for solid in outlines(track.obstacles)]
    return ca.vec(ca.Function("distances", [point], [ca.vertcat(*each)]).map(points_w.shape[1])(points_w))


def curve(start_w: ca.MX, end_w: ca.MX, velocities_w: tuple[ca.MX, ca.MX], step: ca.MX) -> ca.MX:
    """Points [3, P] on cubics between the ends of steps, which have these velocities and last `step` [1, K] s."""
    first, last = (velocity * ca.repmat(step, 3, 1) for velocity in velocities_w)
    points = [start_w]
    for s in BETWEEN:
        weights = 2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, 3 * s**2 - 2 * s**3, s**3 - s**2
        points.append(weights[0] * start_w + weights[1] * first + weights[2] * end_w + weights[3] * last)
    return ca.horzcat(*points)


def straight(start_w: ca.MX, end_w: ca.MX) -> ca.MX:
    """Points [3, P] on straight lines."""
    return ca.horzcat(start_w, *(start_w + s * (end_w - start_w) for s in BETWEEN))


def beyond(track: Track, margin: float, points_w: ca.MX) -> list[tuple[ca.MX, tuple[np.ndarray, np.ndarray]]]:
    """The condition that points keep the margin from all solids; none where there are no solids."""
    if not track.obstacles:
        return []
    found = distances(track, points_w)
    return [(found, (np.full(found.numel(), margin), np.full(found.numel(), np.inf)))]


def solids_struck(track: Track, points_w: np.ndarray) -> tuple[int, ...]:
    """Numbers of the solids that a line of points [T, 3] touches."""
    each = enumerate(outlines(track.obstacles))
    return tuple(k for k, solid in each if (clearance(solid, tuple(points_w.T)).distance <= 0).any())
