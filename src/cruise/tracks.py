"""The built-in tracks: the paper's two, published ones that nobody here trains on, and one whose gates move."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from cruise.config import Gate, Motion, Pole, StartLine, StartPlace, StartPlaces, Track, Vec3, Wall


def _ring() -> Track:
    """Five gates on a circle of 10 m, heights alternating, flown counter-clockwise."""
    heights = (4.0, 3.0, 4.0, 3.0, 4.0)
    angles = [2 * math.pi * k / 5 for k in range(5)]
    gates = tuple(
        Gate((10 * math.cos(a), 10 * math.sin(a), z), a + math.pi / 2) for a, z in zip(angles, heights, strict=True)
    )
    return Track("ring", gates, bounds_low=(-20.0, -20.0, 0.0), bounds_high=(20.0, 20.0, 14.0))


def _figure_eight() -> Track:
    """Six gates, two loops that cross at the origin.

    Yaws are the bisectors of incoming and outgoing segment, not those of the paper's repository, which do not
    face the direction of flight at every gate.
    """
    east, north, west = 0.0, math.pi / 2, math.pi
    rows = [
        ((5.0, -5.0, 1.0), east),
        ((10.0, 0.0, 2.0), north),
        ((5.0, 5.0, 2.0), west),
        ((-5.0, -5.0, 0.5), west),
        ((-10.0, 0.0, 0.5), north),
        ((-5.0, 5.0, 1.5), east),
    ]
    gates = tuple(Gate(position, yaw) for position, yaw in rows)
    return Track("figure-eight", gates, bounds_low=(-20.0, -15.0, 0.0), bounds_high=(20.0, 15.0, 12.0))


PAPER_TRACKS: dict[str, Track] = {track.name: track for track in (_ring(), _figure_eight())}


def _published(name: str, size: float, frame_width: float, rows: list[tuple[float, float, float, float]]) -> Track:
    """Square gates at x, y, z [m] with headings [deg], and room to fly around them."""
    gates = tuple(Gate((x, y, z), math.radians(yaw), size, size) for x, y, z, yaw in rows)
    (x0, x1), (y0, y1) = ((min(axis), max(axis)) for axis in list(zip(*rows, strict=True))[:2])
    low, high = (x0 - 8.0, y0 - 8.0, 0.0), (x1 + 8.0, y1 + 8.0, 10.0)
    return Track(name, gates, low, high, frame_width=frame_width, leave_distance=12.0)


# Foehn, Romero and Scaramuzza, "Time-optimal planning for quadrotor waypoint flight", Science Robotics 2021; places as
# in tracks/track.yaml of uzh-rpg/rpg_time_optimal. It gives no headings: these are the bisectors, to 5 degrees, and
# along x at the gates of the half loop. Openings are those of Kaufmann et al., Nature 2023, who raced there.
_SPLIT_S = _published(
    "split-s",
    1.5,
    0.3,
    [
        (-1.1, -1.6, 3.6, -20),
        (9.2, 6.6, 1.0, 0),
        (9.2, -4.0, 1.2, -130),
        (-4.5, -6.0, 3.5, 180),
        (-4.5, -6.0, 0.8, 0),
        (4.75, -0.9, 1.2, 80),
        (-2.8, 6.8, 1.2, -150),
    ],
)
# The track of the A2RL Drone Championship, Abu Dhabi 2025: Bahnam et al., "MonoRace", 2026, and the same group's
# SkyDreamer code. Openings of 1.5 m in frames of 2.7 m; two pairs of gates stand one on the other.
_A2RL = _published(
    "a2rl-2025",
    1.5,
    0.6,
    [
        (12.5, 2.0, 1.25, 180),
        (6.5, 6.0, 1.25, 135),
        (5.5, 14.0, 1.25, 120),
        (2.5, 24.0, 1.25, 90),
        (7.5, 30.0, 1.25, -10),
        (12.2, 22.0, 1.25, 0),
        (17.5, 30.0, 3.95, 80),
        (17.5, 30.0, 1.25, -100),
        (18.5, 22.0, 1.25, -80),
        (20.5, 14.0, 1.25, -100),
        (18.5, 6.0, 3.95, -135),
        (18.5, 6.0, 1.25, -135),
    ],
)
# Ferede et al., "End-to-end reinforcement learning for time-optimal quadcopter flight", ICRA 2024; places and headings
# as in tudelft/optimal_quad_control_RL, whose axes point north, east and down. The gate in the middle is flown twice.
_DELFT = _published(
    "delft-eight",
    1.0,
    0.2,
    [
        (1.5, 1.5, 1.5, -90),
        (0.0, 0.0, 1.5, 180),
        (-1.5, -1.5, 1.5, -90),
        (0.0, -3.0, 1.5, 0),
        (1.5, -1.5, 1.5, 90),
        (0.0, 0.0, 1.5, 180),
        (-1.5, 1.5, 1.5, 90),
        (0.0, 3.0, 1.5, 0),
    ],
)


def on_arc(gate: Gate, start: Vec3, yaw: float, places: Sequence[float]) -> tuple[StartPlace, ...]:
    """Places 1 m of arc apart on the level circle around a gate through `start`, turned along with it."""
    x, y = start[0] - gate.position_w[0], start[1] - gate.position_w[1]
    radius, bearing = math.hypot(x, y), math.atan2(y, x)
    found = []
    for turn in (place / radius for place in places):
        level = [c + radius * f(bearing + turn) for c, f in zip(gate.position_w, (math.cos, math.sin), strict=False)]
        found.append(StartPlace((level[0], level[1], start[2]), yaw + turn))
    return tuple(found)


# The track of Zurich's multi-drone benchmark (uzh-rpg/marl-racing; "Superhuman Safe and Agile Racing", 2026). Gates 4
# and 5 stand one on the other, their frames 7 cm into each other. Drones start 1 m of arc apart on a circle around gate
# 1; which way round it goes is not printed: here it leads away from gate 7.
_UZH = replace(
    _published(
        "uzh-2026",
        1.5,
        0.275,
        [
            (-0.6, -0.86, 3.68, -20),
            (9.0, 6.45, 1.05, 0),
            (8.85, -3.8, 1.05, -130),
            (-4.3, -5.6, 3.4, 180),
            (-4.3, -5.6, 1.42, 0),
            (4.5, -0.45, 1.05, 80),
            (-1.95, 6.81, 1.05, -150),
        ],
    ),
    bounds_low=(-10.0, -8.0, 0.0),
    bounds_high=(14.0, 9.0, 6.0),
    start_gate=0,
)
_UZH = replace(
    _UZH, start=StartPlaces(on_arc(_UZH.gates[0], (-5.0, 4.7, 0.61), math.radians(-45.0), (0, 1, 2, 3, -1, 4, -2, 5)))
)


# Two tracks of the University of Pennsylvania: "Agile Flight Emerges from Multi-Agent Competitive Racing", 2025, code
# Jirl-upenn/AgileFlight_MultiAgent, and its course ESE 6510. Gates are flown against the printed x axes; openings of
# 1 m in frames of 0.2 m; the box is that of the code. Neither says where drones start: here 2 m before gate 1.
def _upenn(name: str, rows: list[tuple[float, float, float, float]], middle: Vec3, **more: Any) -> Track:
    track = _published(name, 1.0, 0.2, rows)
    start = StartLine(middle, track.gates[0].yaw, 1.0)
    return replace(track, bounds_low=(-6.0, -9.0, 0.0), bounds_high=(5.0, 9.0, 3.0), start=start, **more)


_POWERLOOP = _upenn(
    "powerloop",
    [
        (2.0, 3.5, 0.75, 90),
        (-1.5, 3.5, 2.0, -135),
        (-0.625, 0.0, 0.75, -90),
        (0.625, 0.0, 0.75, -90),
        (-1.5, -3.5, 2.0, -45),
        (2.0, -3.5, 0.75, 90),
        (0.625, 0.0, 0.75, 90),
    ],
    (2.0, 1.5, 0.75),
)
# Four walls, as high as the box; gates 3 and 4 stand one on the other.
_WALLED = _upenn(
    "upenn-walls",
    [
        (1.5, 3.5, 0.75, 135),
        (-1.5, 3.5, 0.75, -135),
        (-2.0, -3.5, 2.0, -90),
        (-2.0, -3.5, 0.75, 90),
        (1.0, -1.0, 2.0, 0),
        (1.0, -3.5, 0.75, 180),
    ],
    (2.9, 2.1, 0.75),
    obstacles=tuple(
        Wall((x, y, 4.0), (length, 0.1, 8.0))
        for x, y, length in ((-2.0, 2.0, 2.0), (0.25, -2.5, 1.5), (3.0, -0.25, 4.0), (0.0, 1.0, 2.0))
    ),
)


BODY = 0.07  # half width of the box that a drone collides as in TU Munich's course; here it is a point [m]


def munich(name: str, gates: Sequence[tuple[Vec3, Vec3]], tops: Sequence[Vec3], starts: Sequence[StartPlace]) -> Track:
    """A track of TU Munich's drone racing course, utiasDSL/lsy_drone_racing, as it is nominally.

    There a drone collides as a box of 0.14 x 0.14 x 0.04 m, here as a point: so everything solid is bigger here, by
    0.07 m, at the sides of gates by as much as a box takes up that does not turn, at poles by half its diagonal.
    Without that, openings are 0.4 m, their frames of 0.02 m reach to 0.36 m from the centre, every gate stands on a box
    of 0.1 m that ends 0.36 m under its centre, and poles have a radius of 15 mm and end 15 mm above their `tops`.

    Args:
        name: of the track.
        gates: centre [m], and roll, pitch and yaw [rad].
        tops: of the poles [m].
        starts: where drones wait, on the ground.
    """
    side, down, diagonal = 0.1 + 2 * BODY, 0.36 - BODY, math.sqrt(2) * BODY
    across = [BODY * (abs(math.cos(yaw)) + abs(math.sin(yaw))) for _, (_, _, yaw) in gates]  # of a box along x and y
    places = [centre for centre, _ in gates]
    stands = [Wall((x, y, (z - down) / 2), (side, side, z - down), yaw) for (x, y, z), (_, _, yaw) in gates if z > down]
    poles = [Pole((x, y, 0.0), z + 0.015 + BODY, 0.015 + diagonal) for x, y, z in tops]
    reach = [max(3.0, *(abs(place[axis]) + 1.5 for place in places)) for axis in range(2)]
    return Track(
        name,
        tuple(
            Gate(centre, yaw, 0.4 - 2 * beside, 0.4 - 2 * BODY, roll, pitch)
            for (centre, (roll, pitch, yaw)), beside in zip(gates, across, strict=True)
        ),
        bounds_low=(-reach[0], -reach[1], 0.0),
        bounds_high=(reach[0], reach[1], max(2.5, *(place[2] + 1.0 for place in places))),
        laps=1,
        finish="last",
        frame_width=0.16 + BODY + max(across),
        frame_depth=0.02 + 2 * BODY,
        leave_distance=2 * max(reach),
        obstacles=(*poles, *stands),
        start=StartPlaces(tuple(starts)),
    )


# Level 2, config/level2.toml, commit eb891d0.
_LSY = munich(
    "lsy-2",
    [
        ((0.5, 0.25, 0.7), (0.0, 0.0, -0.78)),
        ((1.05, 0.75, 1.2), (0.0, 0.0, 2.35)),
        ((-1.0, -0.25, 0.7), (0.0, 0.0, 3.14)),
        ((0.0, -0.75, 1.2), (0.0, 0.0, 0.0)),
    ],
    [(0.0, 0.75, 1.55), (1.0, 0.25, 1.55), (-1.5, -0.25, 1.55), (-0.5, -0.75, 1.55)],
    [StartPlace((-1.5, 0.75, 0.01), 0.0)],
)
PUBLISHED_TRACKS: dict[str, Track] = {
    track.name: track for track in (_SPLIT_S, _A2RL, _DELFT, _UZH, _POWERLOOP, _WALLED, _LSY)
}


def _moving() -> Track:
    """Six gates on an oval of which five move, each in another way and with a period of its own.

    Our own, after the gates that swing while they are flown through of Song and Scaramuzza, "Policy Search for Model
    Predictive Control with Application to Agile Drone Flight", 2022, and those moved by hand of Kaufmann et al., "Deep
    Drone Racing: Learning Agile Flight in Dynamic Environments", 2018.
    """
    swing, quarter = math.radians(30.0), math.pi / 2
    rows: list[tuple[Vec3, float, Motion | None]] = [
        ((0.0, -6.0, 1.5), 0.0, None),
        ((7.0, -3.5, 1.5), 60.0, Motion(4.0, (-0.87, 0.5, 0.0))),  # from side to side
        ((7.0, 3.5, 2.2), 120.0, Motion(3.0, (0.0, 0.0, 0.8))),  # up and down
        ((0.0, 6.0, 1.5), 180.0, Motion(5.0, swing=swing)),  # turns
        ((-7.0, 3.5, 1.5), -120.0, Motion(3.5, (0.4, 0.7, 0.0))),  # towards who comes, and away
        ((-7.0, -3.5, 2.2), -60.0, Motion(4.5, (0.6, 0.35, 0.6), phase=quarter)),  # aslant
    ]
    gates = tuple(Gate(place, math.radians(yaw), 1.6, 1.6, motion=motion) for place, yaw, motion in rows)
    return Track("moving", gates, bounds_low=(-15.0, -14.0, 0.0), bounds_high=(15.0, 14.0, 10.0))


TRACKS: dict[str, Track] = PAPER_TRACKS | PUBLISHED_TRACKS | {"moving": _moving()}
