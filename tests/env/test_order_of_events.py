"""What happens within one step counts in order of time: nothing after the end of a drone's race."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cruise.config import Gate, Pole, Track, Wall
from cruise.env.race_env import make_race_env
from cruise.env.types import RaceState
from cruise.presets import CURRICULUM
from cruise.racing.passes import opening_gaps, passes_per_step
from cruise.racing.track_file import track_faults
from tests.env.races import PAPER, RING, before_gate, forward, race_env, real_rules, rules_of, state_of
from tests.helpers import leaves

ROOM = {"bounds_low": (-20.0, -20.0, 0.0), "bounds_high": (60.0, 20.0, 20.0), "frame_width": 0.0}
SOLIDS = (Pole((-0.6, 0.0, 0.0), 8.0, 0.1), Wall((1.1, 0.0, 4.0), (0.1, 1.0, 8.0)))
ROW = tuple(Gate((x, 0.0, 4.0), 0.0) for x in (0.0, 0.15, 0.5, 30.0))


def idle(state: RaceState) -> jax.Array:
    return jnp.zeros_like(state.drones.body.position_w)


def test_a_gate_is_not_credited_after_the_crash_of_the_same_step() -> None:
    """Two drones meet at the start of the step; one of them would cross the gate's plane near its end."""
    env = race_env(2)
    position = np.stack([before_gate(RING, 0, 0.45), before_gate(RING, 0, 0.45, left=0.26)], axis=1)
    sideways = np.cross([0, 0, 1], forward(RING, 0))
    velocity = np.stack([5.0 * forward(RING, 0), 5.0 * forward(RING, 0) - 2.0 * sideways], axis=1)
    state = state_of(env, position, velocity)
    after, outcome = env.step(state, idle(state), real_rules())
    assert np.asarray(outcome.collisions.drone).all()
    assert float(outcome.crossing.fraction[0]) > 0.8
    assert not np.asarray(outcome.crossing.passed).any()
    assert not np.asarray(after.gates_passed).any()
    alone = state_of(env, position + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 3.0]]), velocity)
    assert bool(env.step(alone, idle(alone), real_rules())[1].crossing.passed[0])


def row_env(obstacles: tuple = ()) -> tuple:
    env = make_race_env(Track("row", ROW, **ROOM, obstacles=obstacles), 2, PAPER)
    return env, jax.jit(env.step)


BARE, SOLID = row_env(), row_env(SOLIDS)


def fly_row(env: tuple, start: float, speed: float, sideways: float = 0.0, **rules: int) -> tuple:
    """Drone 0 flies along x through the row, drone 1 hovers far off: state and outcome."""
    position = np.array([[start, 30.0], [sideways, 9.0], [4.0, 4.0]])
    velocity = np.array([[speed, 0.0], [0.0, 0.0], [0.0, 0.0]])
    state = state_of(env[0], position, velocity)
    after, outcome = env[1](state, idle(state), real_rules(**rules))
    return after, outcome


def test_two_gates_within_one_step_are_both_passed() -> None:
    after, outcome = fly_row(BARE, -0.098, 3.0)
    assert 0.15 < float(after.drones.position_w[0, 0]) < 0.5
    assert int(after.gates_passed[0]) == 2
    assert int(after.next_gate[0]) == 2
    assert bool(outcome.further[0].passed[0])


def test_every_gate_of_a_step_pays_its_bonus() -> None:
    one, two = (fly_row(BARE, start, 3.0)[1] for start in (-0.2, -0.098))
    assert [int(outcome.gates_passed[0]) for outcome in (one, two)] == [1, 2]
    assert float(one.components["gate"][0]) > 0
    assert float(two.components["gate"][0]) == 2 * float(one.components["gate"][0])
    assert float(two.reward[0]) == pytest.approx(2 * float(one.reward[0]))


@settings(max_examples=60, deadline=None)
@given(st.floats(-3.0, 0.7), st.floats(-20.0, 20.0), st.floats(-1.5, 1.5), st.integers(0, 4))
def test_gates_of_a_row_count_as_far_as_the_drone_came(start: float, speed: float, sideways: float, last: int) -> None:
    """One after the other along the flight, until the pole, the wall or the last gate of the race."""
    for env in (BARE, SOLID):
        after, outcome = fly_row(env, start, speed, sideways, gates_to_finish=last)
        (x0, x1) = start, float(after.drones.position_w[0, 0])
        y1 = float(after.drones.position_w[1, 0])
        met = [math.inf]
        if env is SOLID:
            points = np.linspace([x0, sideways], [x1, y1], 4001)
            inside = np.hypot(points[:, 0] + 0.6, points[:, 1]) <= 0.1
            inside |= (np.abs(points[:, 0] - 1.1) <= 0.05) & (np.abs(points[:, 1]) <= 0.5)
            met = [(points[inside.argmax(), 0])] if inside.any() else met
        passed, expected_finish = 0, False
        for gate in ROW[:3]:
            x = gate.position_w[0]
            if not (x0 < x <= x1 and x <= met[0] and abs(sideways) < 0.99) or expected_finish:
                break
            passed += 1
            expected_finish = passed == last
        edges = [abs(x0 - g.position_w[0]) for g in ROW] + [abs(x1 - g.position_w[0]) for g in ROW]
        if min(edges) < 1e-3 or abs(abs(sideways) - 1) < 0.02 or grazes(sideways, x0, x1):
            continue
        assert int(after.gates_passed[0]) == passed
        assert bool(after.finished[0]) == expected_finish
        assert bool(outcome.terminated[0]) == (met[0] < math.inf and not expected_finish)


def grazes(y: float, x0: float, x1: float) -> bool:
    """Whether a verdict hangs on the last millimetres beside pole or wall."""
    beside = [abs(abs(y) - edge) < 5e-3 for edge in (0.1, 0.5)]
    ends = [abs(abs(x - centre) - half) < 2e-3 for x in (x0, x1) for centre, half in ((-0.6, 0.1), (1.1, 0.05))]
    return any(beside + ends)


def test_a_finish_counts_though_the_drone_crashes_after_it() -> None:
    after, outcome = fly_row(SOLID, -0.3, 15.0, gates_to_finish=3)
    assert bool(after.finished[0])
    assert not bool(outcome.terminated[0])
    assert not bool(after.out[0])


def test_steps_of_common_tracks_pass_one_gate_and_pay_for_no_more() -> None:
    assert passes_per_step(RING, 0.1) == 1
    track = Track("row", ROW, **ROOM, leave_distance=20.0)
    assert not track_faults(track)
    np.testing.assert_allclose(opening_gaps(ROW, 4)[0], [0.15, 0.35, 29.5, 30.0], atol=1e-6)
    assert passes_per_step(track, 0.1) == 3
    assert passes_per_step(track, 0.02) == 3
    assert passes_per_step(track, 0.005) == 2


def tilted(track: Track) -> Track:
    """The same gates, said to be tilted by full turns, poles far below the ground and all."""
    return dataclasses.replace(track, gates=tuple(dataclasses.replace(g, roll=2e-30) for g in track.gates))


def test_an_upright_gate_is_one_whose_tilt_is_zero() -> None:
    """Through the equations of tilted gates the same bits come out where the tilt is nothing."""
    upright, tilt = (make_race_env(track, 4, PAPER) for track in (RING, tilted(RING)))
    assert upright.course.tilt is None
    assert tilt.course.tilt is not None
    rules = rules_of(CURRICULUM[-1])

    def fly(env: object) -> list[np.ndarray]:
        @jax.jit
        def run(key: jax.Array) -> tuple:
            state = env.reset(key, (64,))

            def step(now: RaceState, key: jax.Array) -> tuple:
                action = jax.random.uniform(key, now.drones.position_w.shape, minval=-1.0)
                then, outcome = env.step(now, action, rules)
                return then, (outcome.crossing, outcome.collisions, outcome.terminated)

            return jax.lax.scan(step, state, jax.random.split(key, 40))

        return leaves(run(jax.random.key(1)))

    for a, b in zip(fly(upright), fly(tilt), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("angle", [0.6, -1.2])
def test_a_gate_that_looks_down_is_flown_down(angle: float) -> None:
    gate = Gate((0.0, 0.0, 6.0), 0.4, pitch=math.pi / 2, roll=angle, shape="round", width=1.5, height=1.5)
    env = make_race_env(Track("dive", (gate,), **ROOM | {"frame_width": 0.3}), 1, PAPER)
    step = jax.jit(env.step)
    for beside, name in ((0.0, "passed"), (0.7, "passed"), (0.8, "hit_frame"), (1.2, "missed")):
        position = np.array([[beside * 0.6], [beside * 0.8], [6.2]])
        state = state_of(env, position, np.array([[0.0], [0.0], [-5.0]]))
        _, outcome = step(state, idle(state), real_rules())
        seen = [kind for kind in ("passed", "hit_frame", "missed") if bool(getattr(outcome.crossing, kind)[0])]
        assert seen == [name]
        up = state_of(env, position - [[0.0], [0.0], [0.4]], np.array([[0.0], [0.0], [5.0]]))
        assert not bool(step(up, idle(up), real_rules())[1].crossing.passed[0])
