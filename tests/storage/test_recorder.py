"""From a flight to its log: when two drones first touch."""

import numpy as np
import pytest

from cruise.env.types import Collisions
from cruise.presets import TRACKS
from cruise.racing.gates import Crossing
from cruise.rollout import Flight
from cruise.storage.race_log import EventKind
from cruise.storage.recorder import RaceInfo, race_logs


def meeting(start: np.ndarray, end: np.ndarray) -> Flight:
    """One step of 0.1 s in which drone 1 flies from `start` to `end` [3] past drone 0, which stands at the origin."""
    position = np.zeros((2, 3, 2, 1))
    position[:, :, 1, 0] = start, end
    no, zero = np.zeros((1, 2, 1), bool), np.zeros((1, 2, 1))
    samples = np.zeros((2, 2, 1), np.int32)
    return Flight(
        control_dt=0.1,
        position_w=position,
        velocity_w=np.zeros_like(position),
        euler=np.zeros_like(position),
        next_gate=samples,
        airborne=np.array([True, False])[:, None, None] & np.ones((2, 2, 1), bool),
        finished=samples.astype(bool),
        action=np.zeros((1, 4, 2, 1)),
        crossing=Crossing(no, no, no, zero, zero),
        collisions=Collisions._make([no] * len(Collisions._fields))._replace(drone=~no),
    )


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("axis", [0, 2])
def test_two_drones_collide_when_one_enters_the_others_ellipsoid(axis: int, aspect: float) -> None:
    """From 1 m before to 1 m behind: at a semi-axis of 0.25 m to the side, aspect times that from above."""
    way = np.eye(3)[axis]
    info = RaceInfo(TRACKS["ring"], 1, ("racer",), 0.25, ("a", "b"), aspect)
    [log] = race_logs(meeting(way, -way), info)
    semi_axis = 0.25 * (aspect if axis == 2 else 1.0)
    hits = log.event_kind == EventKind.COLLISION_DRONE
    np.testing.assert_allclose(log.event_time[hits], 0.1 * (1 - semi_axis) / 2, rtol=1e-9)
    assert log.event_other[hits].tolist() == [1, 0]
    assert log.collision_aspect == aspect
