"""Swept gate crossing against brute force, and the laws that make it a fair referee."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Gate, Track
from cruise.presets import PAPER_TRACKS
from cruise.racing.course import UNROLLED, make_course
from cruise.racing.gates import Crossing, cross_gates
from tests.helpers import random_track, yaw_matrix
from tests.racing.oracle import SAMPLES, Segments, axes, meet, random_segments

RING = PAPER_TRACKS["ring"]
MANY = random_track(2, gates=UNROLLED + 4)
TILTED = replace(
    random_track(3),
    gates=tuple(
        replace(gate, roll=0.3 * k, pitch=0.4 * (-1) ** k, shape="round" if k % 2 else "rectangle")
        for k, gate in enumerate(random_track(3).gates)
    ),
)
ALL_TRACKS = {**PAPER_TRACKS, "random": random_track(1), "many gates": MANY, "tilted and round": TILTED}
COUNT = 1200
referee = jax.jit(cross_gates)


def judge(track: Track, segments: Segments, tolerance: float = 0.0) -> Crossing:
    """Verdicts of the package."""
    verdict = referee(make_course(track), segments.start, segments.end, segments.target, jnp.float32(tolerance))
    return Crossing(*(np.asarray(part) for part in verdict))


def reverse(segments: Segments) -> Segments:
    return Segments(segments.end, segments.start, segments.target)


def rounding(track: Track, segments: Segments) -> np.ndarray:
    """How far float32 can put off the fraction: 1e-5 m over the motion across the target's plane."""
    forward = np.array([axes(g)[0] for g in track.gates])[segments.target].T
    return 1e-5 / np.maximum(np.abs(np.sum(forward * (segments.end - segments.start), axis=0)), 1e-9)


@pytest.mark.parametrize("tolerance", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("name", ALL_TRACKS)
def test_equals_brute_force(name: str, tolerance: float) -> None:
    track = ALL_TRACKS[name]
    segments = random_segments(track, COUNT, seed=len(name))
    seen, verdict = meet(track, segments, tolerance), judge(track, segments, tolerance)
    assert seen.clear.mean() > 0.9
    for kind in ("passed", "missed", "hit_frame"):
        expected = getattr(seen, kind)[seen.clear]
        assert expected.sum() > 20
        np.testing.assert_array_equal(getattr(verdict, kind)[seen.clear], expected, err_msg=kind)
    slack = 1 / SAMPLES + rounding(track, segments)
    assert (np.abs(verdict.fraction - seen.fraction) <= slack)[seen.crossed].all()
    assert (np.abs(verdict.offset - seen.offset) <= slack * segments.length + 1e-4)[seen.crossed].all()


@pytest.mark.parametrize("tolerance", [0.0, 0.5])
def test_wrong_direction_never_passes_but_frames_hit_both_ways(tolerance: float) -> None:
    segments = random_segments(RING, 5000)
    ahead, back = judge(RING, segments, tolerance), judge(RING, reverse(segments), tolerance)
    there = axes(RING.gates[0])[0]
    assert there[1] > 0.99  # the ring is flown counter-clockwise
    assert ahead.passed.sum() > 50
    assert not (ahead.passed & back.passed).any()
    assert not (ahead.missed & back.missed).any()
    np.testing.assert_array_equal(ahead.hit_frame, back.hit_frame)


def test_no_drone_is_fast_enough_to_jump_a_gate() -> None:
    """Any straight flight from before the opening to behind it passes, from a millimetre to 30 m a step."""
    rng = np.random.default_rng(2)
    track = ALL_TRACKS["random"]
    target = rng.integers(len(track.gates), size=4000)
    centre = np.array([g.position_w for g in track.gates])[target].T
    half = np.array([[g.width / 2, g.height / 2] for g in track.gates])[target].T
    forward, left, up = (np.array(a).T for a in zip(*(axes(track.gates[g]) for g in target), strict=True))
    through = centre + left * rng.uniform(-0.95, 0.95, 4000) * half[0] + up * rng.uniform(-0.95, 0.95, 4000) * half[1]
    slant = forward + 0.5 * rng.uniform(-1, 1, (3, 4000))
    length = np.exp(rng.uniform(np.log(1e-3), np.log(30), (2, 4000)))
    segments = Segments(
        (through - slant * length[0]).astype(np.float32), (through + slant * length[1]).astype(np.float32), target
    )
    assert judge(track, segments).passed.all()


def test_cutting_a_flight_into_steps_counts_its_crossing_once() -> None:
    """However a segment is cut, even exactly in the gate's plane, its pieces pass as often as the whole."""
    gate = Gate((0.0, 0.0, 2.0), 0.0)
    track = Track("one", (gate,), (-50.0, -50.0, 0.0), (50.0, 50.0, 20.0))
    start, end = np.float32([-4.0, 0.5, 2.25]), np.float32([4.0, -0.5, 1.75])
    for cuts in ([0.5], [0.25, 0.5], [0.5, 0.5], [0.1, 0.49, 0.51, 0.9], [0.125, 0.375, 0.5, 0.625]):
        points = np.array([start + f * (end - start) for f in (0.0, *cuts, 1.0)], np.float32).T
        pieces = Segments(points[:, :-1], points[:, 1:], np.zeros(len(cuts) + 1, np.int32))
        verdict = judge(track, pieces)
        assert verdict.passed.sum() == 1, cuts
        assert judge(track, reverse(pieces)).passed.sum() == 0, cuts
    # The plane belongs to the far side: who stands on it has passed, and must come back to pass again.
    on_plane = Segments(np.float32([[0], [0], [2]]), np.float32([[1], [0], [2]]), np.zeros(1, np.int32))
    assert not judge(track, on_plane).passed.any()


@pytest.mark.parametrize("tolerance", [0.0, 0.2, 0.5])
def test_tolerance_widens_the_opening_and_moves_the_frame_behind_it(tolerance: float) -> None:
    """A row of straight flights at growing distance from the edge: pass, then frame, then miss, then a detour."""
    beyond = np.linspace(-0.5, 7.0, 1501)
    beyond = beyond[np.min(np.abs(beyond[:, None] - [tolerance, tolerance + 0.3, 5.0]), axis=1) > 1e-3]
    gate, zero = RING.gates[0], np.zeros_like(beyond)
    for side in (1.0, -1.0):
        x = gate.position_w[0] + side * (gate.width / 2 + beyond)
        y = np.full_like(beyond, gate.position_w[1])
        z = np.full_like(beyond, gate.position_w[2])
        segments = Segments(np.float32([x, y - 1, z]), np.float32([x, y + 3, z]), zero.astype(np.int32))
        verdict = judge(RING, segments, tolerance)
        np.testing.assert_allclose(verdict.offset, beyond, atol=1e-4)
        np.testing.assert_allclose(verdict.fraction, 0.25, atol=1e-4)
        np.testing.assert_array_equal(verdict.passed, beyond < tolerance)
        np.testing.assert_array_equal(verdict.hit_frame, (beyond > tolerance) & (beyond < tolerance + 0.3))
        np.testing.assert_array_equal(verdict.missed, (beyond > tolerance + 0.3) & (beyond < 5.0))


def test_the_frame_of_any_gate_is_solid_but_only_the_target_is_passed_or_missed() -> None:
    segments = random_segments(RING, 5000, seed=3)
    as_target = judge(RING, segments)
    for shift in range(1, len(RING.gates)):
        other = replace(segments, target=(segments.target + shift) % len(RING.gates))
        np.testing.assert_array_equal(judge(RING, other).hit_frame, as_target.hit_frame)
    gate = RING.gates[2]
    forward, left, _ = axes(gate)
    through = np.array(gate.position_w)
    for sideways, name in ((0.0, "passed"), (1.15, "hit_frame"), (2.0, "missed")):
        at = (through + sideways * left)[:, None]
        for target in range(len(RING.gates)):
            ends = (at + step * forward[:, None] for step in (-1, 1))
            flight = Segments(*(end.astype(np.float32) for end in ends), np.array([target]))
            seen = bool(getattr(judge(RING, flight), name)[0])
            assert seen == (target == 2 or name == "hit_frame")


def test_a_thick_frame_is_struck_in_its_middle_or_in_one_of_its_faces() -> None:
    """As the frames of three gates, one in the middle and one where each face is."""
    segments = random_segments(TILTED, COUNT, seed=5)
    faces = [
        replace(TILTED, gates=tuple(replace(g, position_w=tuple(g.position_w + by * axes(g)[0])) for g in TILTED.gates))
        for by in (-0.2, 0.0, 0.2)
    ]
    thick, each = judge(replace(TILTED, frame_depth=0.4), segments), [judge(face, segments) for face in faces]
    np.testing.assert_array_equal(thick.hit_frame, np.any([face.hit_frame for face in each], axis=0))
    assert thick.hit_frame.sum() > each[1].hit_frame.sum() + 10
    np.testing.assert_array_equal(thick.passed, each[1].passed)
    first = np.min([face.frame_fraction for face in each], axis=0)
    np.testing.assert_allclose(thick.frame_fraction, first, atol=1e-4)


@pytest.mark.parametrize("yaw", [0.9, -2.2])
def test_turning_and_moving_the_world_changes_no_verdict(yaw: float) -> None:
    turn, shift = yaw_matrix(yaw), np.array([3.0, -5.0, 1.5])
    track = ALL_TRACKS["random"]
    gates = tuple(replace(g, position_w=tuple(turn @ g.position_w + shift), yaw=g.yaw + yaw) for g in track.gates)
    segments = random_segments(track, 3000, seed=4)
    moved = Segments(
        (turn @ segments.start + shift[:, None]).astype(np.float32),
        (turn @ segments.end + shift[:, None]).astype(np.float32),
        segments.target,
    )
    before, after = judge(track, segments, 0.2), judge(replace(track, gates=gates), moved, 0.2)
    edges = np.min(np.abs(before.offset[:, None] - [0.2, 0.5, 5.0]), axis=1)
    ends = np.minimum(before.fraction, 1 - before.fraction) * segments.length
    clear = (edges > 1e-3) & (ends > 1e-3)
    np.testing.assert_array_equal(before.passed[clear], after.passed[clear])
    np.testing.assert_array_equal(before.missed[clear], after.missed[clear])
    crossed = clear & (before.passed | before.missed)
    slack = rounding(track, segments)
    assert (np.abs(before.fraction - after.fraction) <= slack + 1e-5)[crossed].all()
    assert (np.abs(before.offset - after.offset) <= slack * segments.length + 1e-4)[crossed].all()


def test_batches_of_any_shape_are_judged_alike() -> None:
    segments = random_segments(RING, 12, seed=5)
    flat = judge(RING, segments)
    grid = Segments(segments.start.reshape(3, 3, 4), segments.end.reshape(3, 3, 4), segments.target.reshape(3, 4))
    for whole, part in zip(flat, judge(RING, grid), strict=True):
        np.testing.assert_array_equal(part.reshape(12), whole)
    single = judge(RING, Segments(segments.start[:, 7], segments.end[:, 7], segments.target[7]))
    for whole, part in zip(flat, single, strict=True):
        np.testing.assert_allclose(part, whole[7], atol=1e-6)
