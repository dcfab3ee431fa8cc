"""Named vehicles, tracks, curricula and rewards."""

import math

from cruise.config import Gate, RewardWeights, Stage, Track
from cruise.vehicles import VEHICLES

__all__ = ["CURRICULUM", "REWARDS", "TRACKS", "VEHICLES"]


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


TRACKS: dict[str, Track] = {track.name: track for track in (_ring(), _figure_eight())}

# The paper's curriculum table, row by row.
CURRICULUM: tuple[Stage, ...] = (
    Stage("Basics", 1_000_000, 1.0, 2.0, False, 0.0, 0.5, 0.0, False),
    Stage("Intermediate", 3_000_000, 3.0, 3.0, True, 0.25, 0.3, 0.1, False),
    Stage("Advanced", 6_000_000, 5.0, 4.0, True, 0.5, 0.25, 0.2, False),
    Stage("Advanced II", 10_000_000, 7.0, 6.0, True, 0.6, 0.2, 0.2, True),
    Stage("Advanced III", 20_000_000, 10.0, 7.5, True, 0.7, 0.2, 0.2, True),
)

REWARDS: dict[str, RewardWeights] = {
    "default": RewardWeights(),
    # As printed, with the constants of the paper's repository.
    "paper": RewardWeights(
        w_prox=0.52,
        w_prog=1.51,
        progress_to="centre",
        w_align=0.17,
        w_speed=0.2,
        overtake_sign="paper",
        overtake_range=math.inf,
        gate_bonus=1.0,
        w_edge=0.0,
        w_near=0.0,
        terminal=-1.0,
    ),
}
