"""Tracks with solids in the way of whoever flies straight on."""

import dataclasses

import numpy as np

from cruise.config import Pole, Track, Wall
from cruise.racing.ways import way_between


def middle_of_way(track: Track, number: int) -> np.ndarray:
    """Halfway from a gate to the next, on the way that knows of no solids."""
    gates = track.gates
    way = way_between(gates[number], gates[(number + 1) % len(gates)], track.frame_width)
    return way.point_w[len(way.point_w) // 2]


def pole_in_the_way(track: Track, number: int, radius: float = 0.15) -> Pole:
    """As high as the track."""
    x, y, _ = middle_of_way(track, number).tolist()
    return Pole((x, y, 0.0), track.bounds_high[2], radius)


def wall_in_the_way(track: Track, number: int, yaw: float = 0.3) -> Wall:
    """Three metres long, four high."""
    x, y, _ = middle_of_way(track, number).tolist()
    return Wall((x, y, 2.0), (3.0, 0.3, 4.0), yaw)


def with_solids(track: Track, *solids: Pole | Wall) -> Track:
    return dataclasses.replace(track, obstacles=solids)


def distance(solid: Pole | Wall, points: np.ndarray) -> np.ndarray:
    """From points [P, 3] to the nearest point of a solid [P], 0 inside."""
    if isinstance(solid, Pole):
        beside = np.maximum(np.hypot(*(points[:, :2] - solid.base_w[:2]).T) - solid.radius, 0.0)
        height = points[:, 2] - solid.base_w[2]
        return np.hypot(beside, np.maximum(np.maximum(-height, height - solid.height), 0.0))
    cos, sin = np.cos(solid.yaw), np.sin(solid.yaw)
    local = (points - solid.position_w) @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return np.linalg.norm(np.maximum(np.abs(local) - np.array(solid.size) / 2, 0.0), axis=1)
