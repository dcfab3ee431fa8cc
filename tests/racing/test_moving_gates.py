"""Gates that move: judged in their own frame, and where everybody who knows them says they are."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Gate, Motion, Track
from cruise.presets import TRACKS
from cruise.racing.course import Course, course_at, make_course
from cruise.racing.gates import Crossing, follow_gates
from cruise.racing.motion import gates_at, motion_of_row, motion_row, reach, top_speed
from cruise.racing.passes import passes_per_step
from tests.helpers import random_track
from tests.racing.oracle import random_segments

MOVING = TRACKS["moving"]
DEEP = replace(random_track(3), frame_depth=0.4)
COUNT = 1500
referee = jax.jit(follow_gates, static_argnames="passes")


def shifted(course: Course, by: np.ndarray) -> Course:
    return course._replace(position_w=course.position_w + jnp.asarray(by, jnp.float32)[:, None])


def judge(course: Course, start: np.ndarray, end: np.ndarray, target: np.ndarray) -> Crossing:
    (crossing,) = referee(course, jnp.float32(start), jnp.float32(end), jnp.asarray(target), jnp.float32(0.0))
    return jax.tree.map(np.asarray, crossing)


@pytest.mark.parametrize("track", [TRACKS["ring"], DEEP, random_track(4, gates=20)], ids=["flat", "deep", "many"])
def test_crossings_are_galilean_invariant(track: Track) -> None:
    """Gates that all move with one velocity are passed as they are at rest by drones without that velocity."""
    segments, moved = random_segments(track, COUNT), np.array([1.25, -0.75, 0.5])
    course = make_course(track)
    moving = course._replace(later=shifted(course, moved))
    still = judge(course, segments.start, segments.end, segments.target)
    seen = judge(moving, segments.start, segments.end + moved[:, None], segments.target)
    clear = (np.abs(still.offset) > 1e-3) & (np.abs(still.offset - track.frame_width) > 1e-3)
    for kind in ("passed", "missed"):
        assert getattr(still, kind).sum() > 20
        np.testing.assert_array_equal(getattr(seen, kind)[clear], getattr(still, kind)[clear], err_msg=kind)
    assert (seen.hit_frame == still.hit_frame).mean() > 0.995  # all but hits by a hair
    np.testing.assert_allclose(seen.fraction[still.passed], still.fraction[still.passed], atol=2e-3)


def test_who_moves_with_a_gate_never_crosses_it() -> None:
    course, rng = make_course(MOVING), np.random.default_rng(0)
    here, later = (course_at(course, time) for time in (0.7, 0.8))
    start = np.array(here.position_w)[:, rng.integers(6, size=COUNT)] + rng.normal(scale=0.6, size=(3, COUNT))
    target = np.full(COUNT, 2)  # it moves up and down alone
    with_it = start + np.array(later.position_w - here.position_w)[:, [2]]
    crossing = judge(here._replace(later=later), start, with_it, target)
    assert not (crossing.passed | crossing.missed).any()


def gate(motion: Motion) -> Track:
    return Track("one", (Gate((0.0, 0.0, 2.0), 0.0, 1.5, 1.5, motion=motion),), (-9, -9, 0), (9, 9, 9))


@pytest.mark.parametrize(
    ("motion", "place", "passed", "struck"),
    [
        (
            Motion(2.0, (-1.0, 0.0, 0.0)),
            (-0.5, 0.0, 2.0),
            True,
            False,
        ),  # it comes over the drone, as if that flew through
        (Motion(2.0, (-1.0, 0.0, 0.0)), (-0.5, 0.9, 2.0), False, True),  # by its frame
        (Motion(2.0, (-1.0, 0.0, 0.0)), (-0.5, 1.3, 2.0), False, False),  # beside it
        (Motion(2.0, (1.0, 0.0, 0.0)), (0.5, 0.0, 2.0), False, False),  # backwards
        (Motion(2.0, (1.0, 0.0, 0.0)), (0.5, 0.9, 2.0), False, True),
        (Motion(2.0, swing=0.5), (0.2, 0.8, 2.0), False, False),  # turns away
        (Motion(2.0, swing=0.5), (-0.2, 0.9, 2.0), False, True),  # turns into it
    ],
)
def test_a_gate_sweeps_over_who_hovers(motion: Motion, place: tuple, passed: bool, struck: bool) -> None:
    """In the first quarter of its period, step by step."""
    course, at, crossings = make_course(gate(motion)), np.array(place)[:, None], []
    for step in range(25):
        here, later = (course_at(course, 0.02 * k) for k in (step, step + 1))
        crossings.append(judge(here._replace(later=later), at, at, np.zeros(1, int)))
    assert sum(int(one.passed[0]) for one in crossings) == passed
    assert any(one.hit_frame[0] for one in crossings) == struck


def test_everybody_agrees_where_a_gate_is() -> None:
    course = make_course(MOVING)
    for time in (0.0, 0.4, 3.1, 61.7):
        now, gates = course_at(course, time), gates_at(MOVING.gates, time)
        np.testing.assert_allclose(np.array(now.position_w).T, [gate.position_w for gate in gates], atol=2e-5)
        yaw = np.arctan2(*np.array(now.normal_w)[::-1])
        off = [math.remainder(a - gate.yaw, 2 * math.pi) for a, gate in zip(yaw.tolist(), gates, strict=True)]
        np.testing.assert_allclose(off, 0.0, atol=2e-5)


def test_gates_of_many_races_move_each_by_its_own_time() -> None:
    course, times = make_course(MOVING), jnp.array([[0.0, 0.5], [1.0, 7.0]])
    together = course_at(course, times)
    assert together.position_w.shape == (3, 6, 2, 2)
    for i, j in np.ndindex(2, 2):
        alone = course_at(course, times[i, j])
        np.testing.assert_allclose(together.position_w[:, :, i, j], alone.position_w, atol=1e-6)
        np.testing.assert_allclose(together.normal_w[:, :, i, j], alone.normal_w, atol=1e-6)


def test_motion_stays_within_its_reach_and_speed() -> None:
    times = np.linspace(0.0, 60.0, 4001)
    for one in MOVING.gates:
        places = np.array([now.position_w for time in times for now in gates_at([one], time)])
        centre = math.hypot(*one.motion.sway_w) if one.motion else 0.0
        away = np.linalg.norm(places - one.position_w, axis=1)
        assert away.max() == pytest.approx(centre, rel=1e-3)
        assert centre <= reach(one)
        assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() <= top_speed(one) * times[1] * (1 + 1e-9)
        assert motion_of_row(motion_row(one.motion)) == one.motion


def test_gates_that_may_meet_can_be_passed_in_one_step() -> None:
    near = [Gate((2.0 * k, 0.0, 2.0), 0.0) for k in range(2)]
    far = Gate((30.0, 0.0, 2.0), math.pi)
    track = Track("near", (*near, far), (-9, -9, 0), (40, 9, 9))
    assert passes_per_step(track, 0.02) == 1
    sways = Motion(2.0, (1.3, 0.0, 0.0))
    assert passes_per_step(replace(track, gates=(replace(near[0], motion=sways), *track.gates[1:])), 0.02) == 2
