"""What a drone can hit, against dense sampling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Track
from cruise.presets import TRACKS
from cruise.racing.contacts import meet_opponents, on_ground, out_of_bounds
from cruise.racing.course import make_course
from cruise.racing.field import UNROLLED
from tests.helpers import random_track, yaw_matrix
from tests.racing.oracle import along


def nearest_opponent(start_w, end_w, airborne, aspect=1.0):
    return meet_opponents(start_w, end_w, airborne, 0.0, aspect=aspect)[0]


nearest = jax.jit(nearest_opponent)


def approach(start0_w, end0_w, start1_w, end1_w):
    """Of two drones, which both find."""
    starts, ends = jnp.stack([start0_w, start1_w], axis=1), jnp.stack([end0_w, end1_w], axis=1)
    first, second = nearest(starts, ends, jnp.ones(starts.shape[1:], bool))
    np.testing.assert_array_equal(first, second)
    return first


def random_pairs(count: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Start and end of two drones, [3, count] each: head-on, side by side, standing, meeting in mid-step."""
    rng = np.random.default_rng(seed)
    start0, motion = rng.uniform(-3, 3, (3, count)), rng.normal(size=(3, count)) * rng.choice([0, 0.5, 5], count)
    meeting = start0 + rng.uniform(-0.5, 1.5, count) * motion + rng.normal(size=(3, count)) * 0.3
    other = rng.normal(size=(3, count)) * rng.choice([0, 0.5, 5], count)
    start1 = meeting - rng.uniform(-0.5, 1.5, count) * other
    other = np.where(rng.random(count) < 0.1, motion, other)  # parallel, equally fast: the distance stays
    ends = start0 + motion, start1 + other
    return tuple(a.astype(np.float32) for a in (start0, ends[0], start1, ends[1]))


def sampled_distance(start0: np.ndarray, end0: np.ndarray, start1: np.ndarray, end1: np.ndarray) -> np.ndarray:
    return np.linalg.norm(along(start0, end0) - along(start1, end1), axis=1).min(axis=0)


def test_closest_approach_is_the_minimum_within_the_step() -> None:
    pairs = random_pairs(600)
    expected = sampled_distance(*(p.astype(np.float64) for p in pairs))
    np.testing.assert_allclose(approach(*pairs), expected, atol=5e-3)
    ends = np.minimum(np.linalg.norm(pairs[0] - pairs[2], axis=0), np.linalg.norm(pairs[1] - pairs[3], axis=0))
    assert (expected < ends - 0.3).sum() > 40  # drones that come near between two samples occur


@pytest.mark.parametrize("aspect", [0.5, 2.5])
def test_an_ellipsoid_is_touched_where_its_surface_is(aspect: float) -> None:
    """Distance along the horizontal axes of an ellipsoid `aspect` times as high as wide: that of samples, stretched."""
    pairs = random_pairs(300, seed=4)
    starts, ends = (np.stack([pairs[i], pairs[i + 2]], axis=1) for i in (0, 1))
    flying = np.ones(starts.shape[1:], bool)
    shape = np.array([[1.0], [1.0], [1 / aspect]])
    stretched = [points.astype(np.float64) * shape for points in pairs]
    expected = sampled_distance(*stretched)
    found = np.asarray(nearest_opponent(jnp.asarray(starts), jnp.asarray(ends), jnp.asarray(flying), aspect))
    np.testing.assert_allclose(found, np.stack([expected] * 2), atol=5e-3)


def test_closest_approach_symmetries() -> None:
    """Swapping the drones, flying backwards, or moving the world changes nothing."""
    start0, end0, start1, end1 = random_pairs(1500, seed=1)
    distance = approach(start0, end0, start1, end1)
    np.testing.assert_allclose(approach(start1, end1, start0, end0), distance, atol=1e-4)
    np.testing.assert_allclose(approach(end0, start0, end1, start1), distance, atol=1e-4)
    turn, shift = yaw_matrix(1.1), np.array([[5.0], [-3.0], [2.0]])
    moved = [(turn @ p + shift).astype(np.float32) for p in (start0, end0, start1, end1)]
    np.testing.assert_allclose(approach(*moved), distance, atol=1e-4)


def test_drones_that_swap_places_meet() -> None:
    a, b = np.float32([0, 0, 1]), np.float32([3, 0, 1])
    assert float(approach(a, b, b, a)) == pytest.approx(0, abs=1e-6)
    assert float(approach(a, a, b, b)) == pytest.approx(3, abs=1e-6)


def random_field(drones: int, races: int, seed: int = 2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    start = rng.uniform(-2, 2, (3, drones, races)).astype(np.float32)
    end = start + rng.normal(size=start.shape).astype(np.float32)
    return start, end, rng.random((drones, races)) < 0.7


@pytest.mark.parametrize("drones", [1, 2, 5, UNROLLED + 2])
def test_nearest_opponent_is_the_nearest_in_the_air(drones: int) -> None:
    start, end, airborne = random_field(drones, 40)
    result = np.asarray(nearest(start, end, airborne))
    expected = np.full((drones, 40), np.inf)
    for i in range(drones):
        for j in range(drones):
            both = airborne[i] & airborne[j]
            if i != j:
                distance = sampled_distance(start[:, i], end[:, i], start[:, j], end[:, j])
                expected[i] = np.minimum(expected[i], np.where(both, distance, np.inf))
    assert np.isinf(result[~airborne]).all()
    np.testing.assert_allclose(result, expected, atol=2e-3)


def test_who_has_left_the_air_obstructs_nobody() -> None:
    """Where the others are told nothing of a drone that is out, its position cannot matter."""
    start, end, airborne = random_field(4, 60)
    elsewhere = np.where(airborne, 0, 1) * np.float32(100.0)
    moved = nearest(start + elsewhere, end + elsewhere, airborne)
    np.testing.assert_array_equal(nearest(start, end, airborne), moved)
    airborne[2] = False
    rest = [0, 1, 3]
    without = nearest(start[:, rest], end[:, rest], airborne[rest])
    np.testing.assert_allclose(np.asarray(nearest(start, end, airborne))[rest], without, atol=1e-6)


@pytest.mark.parametrize("track", [*TRACKS.values(), random_track(3)], ids=lambda t: t.name)
def test_out_of_bounds_is_outside_the_box_or_far_from_every_gate(track: Track) -> None:
    low, high = np.array(track.bounds_low), np.array(track.bounds_high)
    points = np.random.default_rng(4).uniform(low - 6, high + 6, (8000, 3)).astype(np.float32)
    gates = np.array([g.position_w for g in track.gates])
    distance = np.linalg.norm(points[:, None] - gates, axis=2).min(axis=1)
    beyond = np.maximum(points - high, np.where([True, True, False], low - points, -np.inf)).max(axis=1)
    clear = (np.abs(distance - track.leave_distance) > 1e-3) & (np.abs(beyond) > 1e-3)
    result = np.asarray(jax.jit(out_of_bounds)(make_course(track), points.T))
    expected = (beyond > 0) | (distance > track.leave_distance)
    assert 0.1 < expected.mean() < 0.95
    np.testing.assert_array_equal(result[clear], expected[clear])


def test_the_ground_is_z_zero() -> None:
    heights = jnp.array([1.0, 1e-6, 0.0, -1.0])
    position = jnp.stack([jnp.zeros(4), jnp.ones(4), heights])
    np.testing.assert_array_equal(on_ground(position), [False, False, True, True])
