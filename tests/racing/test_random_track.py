"""Tracks drawn at random: sound, flyable by a line that is computed, harder with difficulty, the same by seed."""

import dataclasses
import hashlib
import math

import numpy as np
import pytest

from cruise.config import Gate, Track, TrainConfig
from cruise.errors import CruiseError
from cruise.evaluation.matches import make_match, run_races
from cruise.presets import PUBLISHED_TRACKS, TRACKS
from cruise.racing.detours import BERTHS
from cruise.racing.random_track import (
    CLEARANCE,
    NEAREST_GROUND,
    SHARPEST,
    is_flyable,
    random_track,
    random_tracks,
    training_track,
    unseen_tracks,
)
from cruise.racing.solids import outlines
from cruise.racing.track_file import RANDOM, RANDOM_KINDS, load_one_track, load_track, save_track, track_faults
from cruise.racing.track_geometry import lap_length
from cruise.racing.ways import ways
from cruise.storage.log_track import gates_of, solids_of
from tests.racing.obstacles import distance

DRAWN = [
    random_track(seed, gates, difficulty) for seed in range(4) for gates in (3, 8) for difficulty in (0.0, 0.5, 1.0)
]


def frame_distance(point: np.ndarray, gate: Gate, frame_width: float) -> float:
    """From a point in the plane of a gate to the nearest point of its frame, a square ring."""
    sideways = -math.sin(gate.yaw) * (point[0] - gate.position_w[0]) + math.cos(gate.yaw) * (
        point[1] - gate.position_w[1]
    )
    across = max(abs(sideways), abs(point[2] - gate.position_w[2]))
    inner = gate.width / 2
    return max(inner - across, across - inner - frame_width, 0.0)


@pytest.mark.parametrize("track", DRAWN)
def test_tracks_have_no_faults_and_a_line_that_clears_everything(track):
    assert track_faults(track) == []
    line = np.concatenate([way.point_w for way in ways(track)])
    assert line[:, 2].min() >= NEAREST_GROUND
    for gate in track.gates:
        forward = (line[:, :2] - gate.position_w[:2]) @ (math.cos(gate.yaw), math.sin(gate.yaw))
        for k in np.flatnonzero((forward[:-1] < 0) != (forward[1:] < 0)):
            share = forward[k] / (forward[k] - forward[k + 1])
            crossing = line[k] + share * (line[k + 1] - line[k])
            assert frame_distance(crossing, gate, track.frame_width) > CLEARANCE - 0.05


@pytest.mark.parametrize("track", DRAWN)
def test_the_line_leads_through_every_gate_along_its_normal(track):
    for gate, way in zip(track.gates, ways(track), strict=True):
        np.testing.assert_allclose(way.point_w[0], gate.position_w, atol=1e-9)
        np.testing.assert_allclose(way.tangent_w[0], (math.cos(gate.yaw), math.sin(gate.yaw), 0.0), atol=1e-9)
        assert way.curvature.max() <= SHARPEST


def test_a_track_whose_line_strikes_a_frame_or_the_ground_is_not_flyable():
    opening = {"width": 2.0, "height": 2.0}
    square = [Gate((0, 0, 2), 0, **opening), Gate((20, 0, 2), 0, **opening), Gate((20, 20, 2), math.pi, **opening)]
    free = Track("free", tuple(square), (-40, -40, 0), (60, 60, 20))
    assert is_flyable(free)
    across = Gate((10, 1.15, 2), 0, **opening)  # its frame stands on the way from the first gate to the second
    assert not is_flyable(dataclasses.replace(free, gates=(*square, across)))
    low = tuple(dataclasses.replace(gate, position_w=(*gate.position_w[:2], 0.3)) for gate in square)
    assert not is_flyable(dataclasses.replace(free, gates=low))


def test_the_same_seed_gives_the_same_track_and_another_one_another():
    assert random_track(7, 6, 0.7) == random_track(7, 6, 0.7)
    assert random_track(7, 6, 0.7) != random_track(8, 6, 0.7)


def test_harder_tracks_are_denser_higher_and_turn_more():
    easy, hard = ([random_track(seed, 8, difficulty) for seed in range(12)] for difficulty in (0.0, 1.0))

    def mean(of, tracks):
        return np.mean([of(track) for track in tracks])

    def rise(track):
        return np.ptp([gate.position_w[2] for gate in track.gates])

    def turning(track):
        return sum(
            float((way.curvature[:-1] * np.linalg.norm(np.diff(way.point_w, axis=0), axis=1)).sum())
            for way in ways(track)
        )

    assert mean(lambda track: lap_length(track.gates), hard) < 0.8 * mean(lambda track: lap_length(track.gates), easy)
    assert mean(rise, hard) > 2 * mean(rise, easy)
    assert mean(turning, hard) > 2 * mean(turning, easy)


def test_half_of_the_tracks_are_flown_the_other_way_round():
    def sense(track):
        (x0, y0, _), (x1, y1, _) = (gate.position_w for gate in track.gates[:2])
        return np.sign(x0 * y1 - x1 * y0)

    assert 0 < sum(sense(random_track(seed, 8, 0.0)) > 0 for seed in range(20)) < 20


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"seed": -1}, "seed must be 0 or more"),
        ({"gates": 2}, "from 3 to 40 gates, not 2"),
        ({"difficulty": 1.5}, "difficulty must be from 0 to 1, not 1.5"),
        ({"difficulty": math.nan}, "difficulty must be from 0 to 1, not nan"),
        ({"obstacles": 61}, "from 0 to 60 obstacles, not 61"),
        ({"tilt": math.pi}, "tilt must be from 0 to 60 degrees, not 180"),
    ],
)
def test_numbers_out_of_range_are_refused(arguments, words):
    with pytest.raises(CruiseError, match=words):
        random_track(**{"seed": 0} | arguments)


@pytest.mark.parametrize("more", [{}, {"obstacles": 6, "tilt": 0.4}])
def test_a_random_track_survives_its_file(tmp_path, more):
    track = random_track(5, 6, 0.9, **more)
    save_track(track, tmp_path / "drawn.toml")
    assert load_track(tmp_path / "drawn.toml") == track


def test_variants_have_the_same_number_and_sizes_of_gates_and_lie_within_the_bounds():
    track = random_tracks(3, 6)
    assert len(track.variants) == 6
    for gates in track.variants:
        assert [gate.width for gate in gates] == [gate.width for gate in track.gates]
        alone = dataclasses.replace(track, gates=gates, variants=())
        assert track_faults(alone) == []


def test_no_track_of_a_training_is_one_that_policies_are_measured_on(monkeypatch):
    monkeypatch.setattr("cruise.racing.random_track.TRAINING", 20)
    unseen = set(unseen_tracks().variants)
    for seed in (0, 1):
        assert not unseen & set(training_track(TrainConfig(track=RANDOM, seed=seed)).variants)


def test_what_needs_one_track_refuses_many():
    with pytest.raises(CruiseError, match="a new track in every race"):
        load_one_track(RANDOM)
    assert load_one_track("ring") == TRACKS["ring"]


def test_cluttered_variants_differ_in_tilt_and_solids_and_races_fly_them():
    """Of each kind as many as the variant with most has; the rest lies where nobody flies, and in no log."""
    track = random_tracks(0, 3, kind="random-cluttered")
    assert len(set(track.variant_obstacles)) == len(set(track.variants)) == 3
    assert all(len(solids) == RANDOM_KINDS["random-cluttered"][0] for solids in track.variant_obstacles)
    logs = list(run_races(make_match(track, 1, "hover"), 6, seed=1))
    flown = set()
    for log in logs:
        gates = gates_of(log)
        (number,) = (
            n
            for n, known in enumerate(track.variants)
            if np.allclose([g.position_w for g in known], [g.position_w for g in gates], atol=1e-5)
        )
        turns = [[(gate.pitch, gate.roll) for gate in some] for some in (gates, track.variants[number])]
        np.testing.assert_allclose(*turns, atol=1e-5)
        standing = [
            sorted(solid.centre_w for solid in some)
            for some in (solids_of(log), outlines(track.variant_obstacles[number]))
        ]
        np.testing.assert_allclose(*standing, atol=1e-5)
        flown.add(number)
    assert len(flown) > 1


@pytest.mark.parametrize("track", PUBLISHED_TRACKS.values(), ids=str)
def test_published_tracks_are_sound(track):
    assert track_faults(track) == []
    if track.name != "lsy-2":  # there the drone is a box, and what it leaves of an opening depends on how that stands
        assert len({gate.width for gate in track.gates}) == 1


def test_a_gate_may_be_flown_twice_a_lap_but_not_share_room_with_another():
    twice = PUBLISHED_TRACKS["delft-eight"]
    middle = [k for k, gate in enumerate(twice.gates) if gate.position_w[:2] == (0.0, 0.0)]
    assert len(middle) == 2
    gates = list(twice.gates)
    gates[middle[1]] = dataclasses.replace(gates[middle[1]], yaw=gates[middle[1]].yaw + 0.3)
    assert any("overlaps" in fault for fault in track_faults(dataclasses.replace(twice, gates=tuple(gates))))


def test_seeds_give_the_tracks_that_they_always_gave():
    """A digest of six, from before tilt and obstacles could be asked for."""
    tracks = [random_track(seed, 8, seed / 5) for seed in range(6)]
    numbers = [(*gate.position_w, gate.yaw, gate.width) for track in tracks for gate in track.gates]
    assert hashlib.sha256(repr(numbers).encode()).hexdigest()[:16] == "e3752dddb8a1a66f"


@pytest.mark.parametrize("seed", range(3))
def test_tilt_and_obstacles(seed):
    track = random_track(seed, 8, 0.5, obstacles=6, tilt=0.5)
    assert track == random_track(seed, 8, 0.5, obstacles=6, tilt=0.5)
    assert track_faults(track) == []
    assert len(track.obstacles) == 6
    turns = np.array([(gate.roll, gate.pitch) for gate in track.gates])
    assert 0.1 < np.abs(turns).max() <= 0.5
    bare = dataclasses.replace(track, obstacles=())
    line = np.concatenate([way.point_w for way in ways(bare)])
    assert min(distance(solid, line).min() for solid in track.obstacles) >= BERTHS[0] - 1e-6
    np.testing.assert_array_equal(np.concatenate([way.point_w for way in ways(track)]), line)
    gates = np.array([gate.position_w for gate in track.gates])
    assert min(distance(solid, gates).min() for solid in track.obstacles) > 0.75


def test_gates_are_those_of_the_track_without_obstacles():
    assert random_track(2, obstacles=5).gates == random_track(2).gates
    assert random_track(2, obstacles=5, tilt=0.3).gates == random_track(2, tilt=0.3).gates


def test_where_drones_wait_nothing_stands():
    """Three rows of four behind any gate, and none of them within half a metre of a solid."""
    track = random_track(4, 8, 0.5, obstacles=10)
    for gate in track.gates:
        forward = np.array([math.cos(gate.yaw), math.sin(gate.yaw), 0.0])
        left = np.array([-forward[1], forward[0], 0.0])
        grid = [
            gate.position_w - back * forward + side * left
            for back in (2.0, 3.5, 5.0)
            for side in (-1.9, -0.6, 0.6, 1.9)
        ]
        assert min(distance(solid, np.array(grid)).min() for solid in track.obstacles) > 0.5
