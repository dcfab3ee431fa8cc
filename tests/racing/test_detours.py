"""Ways go around solids and through tilted gates along their normals, and else are what they were without."""

import dataclasses
import math

import numpy as np
import pytest

from cruise.config import Gate, Pole, Track, Wall
from cruise.presets import TRACKS
from cruise.racing.clearance import clearance
from cruise.racing.detours import BERTHS
from cruise.racing.solids import outlines
from cruise.racing.ways import SHARPEST, normal_of, ways
from tests.racing.obstacles import distance, pole_in_the_way, wall_in_the_way, with_solids

RING = TRACKS["ring"]
RNG = np.random.default_rng(0)


def flown(track):
    return np.concatenate([way.point_w for way in ways(track)])


@pytest.mark.parametrize("name", ["ring", "figure-eight", "split-s"])
def test_ways_keep_away_from_poles_that_stand_on_them(name):
    track = TRACKS[name]
    solids = [pole_in_the_way(track, number) for number in (0, 1)]
    assert min(distance(pole, flown(track)).min() for pole in solids) < 0.05
    around = with_solids(track, *solids)
    assert min(distance(pole, flown(around)).min() for pole in solids) >= BERTHS[-1] - 1e-6


@pytest.mark.parametrize("yaw", [0.3, 1.2, 2.5])
def test_ways_keep_away_from_a_wall_and_bend_gently(yaw):
    track = with_solids(RING, wall_in_the_way(RING, 3, yaw))
    assert distance(track.obstacles[0], flown(track)).min() >= BERTHS[-1] - 1e-6
    assert max(way.curvature.max() for way in ways(track)) <= SHARPEST
    length = sum(float(way.steps.sum()) for way in ways(track))
    assert length < 1.15 * sum(float(way.steps.sum()) for way in ways(RING))


def test_a_low_wall_is_flown_over_and_a_wide_one_too():
    x, y, _ = pole_in_the_way(RING, 0).base_w
    for wall in (Wall((x, y, 0.5), (3.0, 0.3, 1.0), 0.3), Wall((x, y, 1.5), (14.0, 0.3, 3.0), 0.3)):
        track = with_solids(RING, wall)
        assert distance(wall, flown(track)).min() >= BERTHS[-1] - 1e-6


def test_nothing_in_the_way_changes_nothing():
    far = with_solids(RING, Pole((0.0, 0.0, 0.0), 5.0, 0.3))
    for there, without in zip(ways(far), ways(RING), strict=True):
        np.testing.assert_array_equal(there.point_w, without.point_w)


def test_where_there_is_no_way_the_line_leads_on():
    """A wall across the whole hall up to its ceiling."""
    wall = Wall((*pole_in_the_way(RING, 0).base_w[:2], 7.0), (80.0, 0.3, 14.0), 0.3)
    np.testing.assert_array_equal(ways(with_solids(RING, wall))[0].point_w, ways(RING)[0].point_w)


TILTED = (
    Gate((8, 0, 3), math.pi / 2, roll=0.4),
    Gate((0, 8, 5), math.pi, pitch=math.pi / 2, shape="round", width=2.5),
    Gate((-8, 0, 2), -math.pi / 2, shape="round"),
    Gate((0, -8, 3), 0.0, pitch=-0.9, roll=-0.3),
)


def test_tilted_gates_are_crossed_along_their_normals():
    track = Track("tilted", TILTED, (-15, -15, 0), (15, 15, 10))
    for gate, way in zip(TILTED, ways(track), strict=True):
        cos, sin = math.cos(gate.pitch), math.sin(gate.pitch)
        normal = np.array([math.cos(gate.yaw) * cos, math.sin(gate.yaw) * cos, -sin])
        np.testing.assert_allclose(normal_of(gate), normal, atol=1e-12)
        np.testing.assert_allclose(way.tangent_w[0], normal, atol=1e-6)
        np.testing.assert_allclose(way.point_w[0], gate.position_w, atol=1e-9)


@pytest.mark.parametrize("solid", [Pole((1.0, 2.0, 0.0), 3.0, 0.4), Wall((1.0, 2.0, 1.5), (3.0, 0.5, 3.0), 0.7)])
def test_clearance_is_never_more_than_the_distance_and_says_inside_from_outside(solid):
    points = RNG.uniform((-4, -3, 0), (6, 7, 6), (4000, 3))
    (outline,) = outlines((solid,))
    found, true = clearance(outline, tuple(points.T)).distance, distance(solid, points)
    assert (found <= true + 1e-9).all()
    assert ((found <= 0) == (true == 0)).all()
    assert (found >= true / math.sqrt(3) - 1e-9)[true > 0].all()


def test_via_points_stay_within_the_box():
    """A pole beside which there is room on one side alone."""
    pole = pole_in_the_way(RING, 0)
    x, y, _ = pole.base_w
    tight = dataclasses.replace(with_solids(RING, pole), bounds_high=(x + 0.9, 20.0, 14.0))
    line = ways(tight)[0].point_w
    beside = line[np.abs(line[:, 1] - y).argmin()]
    assert beside[0] < x
