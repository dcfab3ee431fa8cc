"""Poles and walls drawn at random beside the ways of a track. Plain NumPy: no JAX."""

import dataclasses
import math

import numpy as np

from cruise.config import Obstacle, Pole, Track, Wall
from cruise.errors import CruiseError
from cruise.racing.clearance import clearance
from cruise.racing.detours import BERTHS
from cruise.racing.solids import KINDS, outlines
from cruise.racing.track_file import track_faults
from cruise.racing.ways import ways

MOST_OBSTACLES = 60
BESIDE = (1.0, 4.0)  # distance of a solid's middle from a way, beyond what the way keeps from it [m]
POLE_RADIUS, WALL_LENGTH, WALL_THICKNESS = (0.08, 0.3), (1.0, 4.0), 0.2  # [m]
SOLID_HEIGHT = (2.0, 6.0)  # [m]
GRID = (1.5, 6.0), (-2.0, 2.0)  # drones wait so far behind a gate and beside its middle [m]
GRID_ROOM = 0.6  # that is kept free around them [m]
SPOTS = 200  # tried for every solid


def with_obstacles(rng: np.random.Generator, track: Track, number: int) -> Track:
    """The track with poles and walls beside its ways, which stay as they are.

    Raises:
        CruiseError: no room for so many was found.
    """
    if number == 0:
        return track
    flown = np.concatenate([way.point_w for way in ways(track)])
    for _ in range(number):
        tries = (_obstacle(rng, flown) for _ in range(SPOTS))
        wider = (dataclasses.replace(track, obstacles=(*track.obstacles, solid)) for solid in tries)
        found = next((one for one in wider if _leaves_room(one, flown) and not track_faults(one)), None)
        if found is None:
            raise CruiseError(f"there is no room for {number} obstacles beside the ways of {track.name}: ask for fewer")
        track = found
    kinds = [kind.made_of for kind in KINDS]  # in whose order a file has them
    solids = sorted(track.obstacles, key=lambda solid: kinds.index(type(solid)))
    return dataclasses.replace(track, obstacles=tuple(solids))


def _grids(track: Track) -> np.ndarray:
    """Places [P, 3] where drones may wait for a start before any of the gates."""
    back, side = (np.ravel(axis) for axis in np.meshgrid(*(np.linspace(*ends, 5) for ends in GRID)))
    places = []
    for gate in track.gates:
        forward, left = (
            np.array([math.cos(gate.yaw), math.sin(gate.yaw)]),
            np.array([-math.sin(gate.yaw), math.cos(gate.yaw)]),
        )
        flat = np.array(gate.position_w[:2]) - back[:, None] * forward + side[:, None] * left
        places.append(np.column_stack([flat, np.full(len(flat), gate.position_w[2])]))
    return np.concatenate(places)


def _obstacle(rng: np.random.Generator, flown: np.ndarray) -> Obstacle:
    """A pole or a wall on the ground, somewhere beside a way."""
    x, y, _ = flown[rng.integers(len(flown))]
    away, towards = BERTHS[0] + rng.uniform(*BESIDE), rng.uniform(0, math.tau)
    x, y = round(float(x + away * math.cos(towards)), 2), round(float(y + away * math.sin(towards)), 2)
    height = round(float(rng.uniform(*SOLID_HEIGHT)), 2)
    if rng.random() < 0.5:
        return Pole((x, y, 0.0), height, round(float(rng.uniform(*POLE_RADIUS)), 2))
    size = (round(float(rng.uniform(*WALL_LENGTH)), 2), WALL_THICKNESS, height)
    return Wall((x, y, height / 2), size, round(float(rng.uniform(0, math.pi)), 3))


def _leaves_room(track: Track, flown: np.ndarray) -> bool:
    """Whether the last solid is clear of the ways, of all gates and of the other solids."""
    *others, last = outlines(track.obstacles)
    gates = np.array([gate.position_w for gate in track.gates])
    reach = np.array([math.hypot(gate.width, gate.height) / 2 + track.frame_width for gate in track.gates])
    apart = [
        math.dist(last.centre_w[:2], one.centre_w[:2]) > (max(last.size[:2]) + max(one.size[:2])) for one in others
    ]
    grids = clearance(last, tuple(_grids(track).T))
    if bool((grids.distance < GRID_ROOM).any()):
        return False
    way_is_clear = bool((clearance(last, tuple(flown.T)).distance >= BERTHS[0]).all())
    return all(apart) and way_is_clear and bool((clearance(last, tuple(gates.T)).beside >= reach).all())
