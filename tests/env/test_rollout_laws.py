"""Laws that every step of a race obeys, checked on recorded flights; batches, keys and mirrors."""

import functools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Track
from cruise.dynamics import RigidBody
from cruise.env.types import RaceState
from cruise.presets import CURRICULUM, REWARDS
from tests.env import paper_reference as paper
from tests.env.races import RING, Recorded, fly_to_gates, lined_up, race_env, real_rules, record, rules_of
from tests.helpers import assert_trees_close, random_track

RACES = 32
RULES = {"early": rules_of(CURRICULUM[2]), "late": rules_of(CURRICULUM[4]), "race": real_rules(gates_to_finish=4)}


@functools.cache
def flight(kind: str) -> Recorded:
    """Four drones with a straying pilot, printed weights: leaves [T, ...]."""
    env = race_env(4, RING, REWARDS["paper"])
    return fly_to_gates(env, lined_up(env, RING, RACES), 150, 4.0, RULES[kind], noise=0.6)


@pytest.mark.parametrize("kind", RULES)
def test_gates_and_clock(kind: str) -> None:
    before, _, after, outcome = flight(kind)
    passed = outcome.crossing.passed
    assert passed.sum() > 50
    np.testing.assert_array_equal(after.gates_passed, before.gates_passed + passed)
    np.testing.assert_array_equal(after.next_gate, (before.next_gate + passed) % 5)
    np.testing.assert_array_equal(after.next_gate, (before.next_gate[0] + after.gates_passed) % 5)
    np.testing.assert_array_equal(after.step, np.arange(1, 151)[:, None] * np.ones(RACES))


@pytest.mark.parametrize("kind", RULES)
def test_who_ends_and_why(kind: str) -> None:
    before, _, after, outcome = flight(kind)
    hits = outcome.collisions
    solid = hits.drone | hits.ground | hits.gate_frame
    expected = hits.bounds | hits.flip | (solid if kind != "early" else False)
    np.testing.assert_array_equal(outcome.terminated, expected)
    np.testing.assert_array_equal(after.out, before.out | outcome.terminated)
    assert outcome.terminated.any() == (kind != "early")
    assert solid.any()
    finishing = after.finished & ~before.finished
    if kind == "race":
        assert finishing.any()
        assert (after.gates_passed[finishing] == 4).all()
    else:
        assert not after.finished.any()
    assert not (after.finished & after.out).any()


@pytest.mark.parametrize("kind", ["late", "race"])
def test_who_has_left_the_air_takes_no_part(kind: str) -> None:
    before, _, after, outcome = flight(kind)
    gone = before.out | before.finished
    assert gone.any()
    assert (outcome.reward[gone] == 0).all()
    assert not outcome.terminated[gone].any()
    assert not outcome.crossing.passed[gone].any()
    assert not any(hit[gone].any() for hit in outcome.collisions)
    for now, then in zip(jax.tree.leaves(before.drones), jax.tree.leaves(after.drones), strict=True):
        still = np.broadcast_to(gone[:, None], now.shape)
        np.testing.assert_array_equal(now[still], then[still])


def test_drone_collisions_are_those_of_the_flown_segments() -> None:
    """Never fewer than the paper's end-of-step test finds, and symmetric within the step."""
    before, _, after, outcome = flight("late")
    flying = ~(before.out | before.finished)
    printed = np.zeros_like(outcome.collisions.drone)
    for t in range(0, 150, 3):
        for e in range(RACES):
            for i in range(4):
                printed[t, i, e] = paper.r_coll(i, after.drones.body.position_w[t, :, :, e], flying[t, :, e], 0.5)
    assert printed.any()
    assert not (printed & ~outcome.collisions.drone).any()
    together = outcome.collisions.drone.sum(axis=1)
    assert (together != 1).all()  # nobody collides alone


def in_float64(body: RigidBody, t: int, e: int) -> dict[str, np.ndarray]:
    """Positions and velocities of one race at one time, [3, N]."""
    return {"p": body.position_w[t, ..., e].astype(np.float64), "v": body.velocity_w[t, ..., e].astype(np.float64)}


def test_rewards_of_a_flight_are_the_papers() -> None:
    """The printed weights on real steps: sum of the six terms, one for a gate, minus one at the end, clipped."""
    before, _, after, outcome = flight("late")
    stage, gates = CURRICULUM[4], np.array([g.position_w for g in RING.gates])
    checked = 0
    for t in range(0, 150, 5):
        for e in range(0, RACES, 4):
            now, then = (in_float64(s.drones.body, t, e) for s in (before, after))
            flying = ~before.out[t, :, e]
            for i in np.flatnonzero(flying & ~outcome.crossing.passed[t, :, e]):
                gate = gates[before.next_gate[t, i, e]]
                old, new = (np.linalg.norm(gate - state["p"][:, i]) for state in (now, then))
                total = 0.52 * paper.r_prox(new) + 1.51 * paper.r_prog(old, new)
                total -= 0.17 * paper.r_align(then["p"][:, i], then["v"][:, i], gate)
                total += 0.20 * paper.r_speed(then["v"][:, i], stage.v_min)
                total += stage.w_over * paper.r_over(i, now, then, flying, "paper", np.inf)
                expected = -1.0 if outcome.terminated[t, i, e] else np.clip(total, -1, 1)
                assert outcome.reward[t, i, e] == pytest.approx(expected, abs=1e-4)
                checked += 1
    assert checked > 200
    alone = outcome.crossing.passed & ~outcome.terminated & (outcome.components["over"] == 0)
    assert (outcome.reward[alone] == 1.0).all()


def test_reset_is_a_function_of_its_key() -> None:
    env = race_env(4, RING, REWARDS["paper"])
    one, again, other = (env.reset(jax.random.key(k), batch=(RACES,)) for k in (3, 3, 4))
    assert_trees_close(one, again)
    assert not np.array_equal(one.drones.body.position_w, other.drones.body.position_w)
    for state in (one, other):
        assert np.asarray(state.airborne).all()
        assert not np.asarray(state.gates_passed).any()
        assert (np.asarray(state.drones.body.velocity_w) == 0).all()
        assert (np.asarray(state.next_gate) == np.asarray(state.next_gate)[0]).all()
    fixed = env.reset(jax.random.key(3), batch=(RACES,), gate=2)
    assert (np.asarray(fixed.next_gate) == 2).all()


def test_one_race_is_a_batch_of_races() -> None:
    """Steps of the recorded races, flown again alone."""
    env, recorded = race_env(4, RING, REWARDS["paper"]), flight("late")
    for t, e in ((20, 3), (80, 17), (140, 30)):
        before, action, after, outcome = jax.tree.map(lambda x, t=t, e=e: jnp.asarray(x[t, ..., e]), recorded)
        assert_trees_close(env.step(before, action, RULES["late"]), (after, outcome), atol=2e-5)


def mirrored_track(track: Track) -> Track:
    """Seen in a mirror in the x-z plane."""
    gates = []
    for gate in track.gates:
        x, y, z = gate.position_w
        gates.append(replace(gate, position_w=(x, -y, z), yaw=-gate.yaw))
    low, high = list(track.bounds_low), list(track.bounds_high)
    low[1], high[1] = -track.bounds_high[1], -track.bounds_low[1]
    return replace(track, gates=tuple(gates), bounds_low=tuple(low), bounds_high=tuple(high))


def mirrored(state: RaceState) -> RaceState:
    vector, axial = (np.float32(v)[:, None, None] for v in ([1, -1, 1], [-1, 1, -1]))
    position, velocity, euler, rates = state.drones.body
    body = type(state.drones.body)(position * vector, velocity * vector, euler * axial, rates * axial)
    return state._replace(drones=state.drones._replace(body=body, memory=state.drones.memory * vector))


def test_the_mirrored_race_has_the_same_story() -> None:
    """Same rewards, crossings and collisions on the mirrored track; the paper's observation mirrored."""
    track = random_track(9, gates=3)
    env, mirror = race_env(2, track), race_env(2, mirrored_track(track))
    start = lined_up(env, track, RACES)
    actions = np.random.default_rng(0).uniform(-1, 1, (60, 3, 2, RACES)).astype(np.float32) * 0.7
    sides = np.float32([1, -1, 1])[:, None, None]
    one, other = record(env, start, actions, rules_of()), record(mirror, mirrored(start), actions * sides, rules_of())
    np.testing.assert_allclose(other.outcome.reward, one.outcome.reward, atol=1e-4)
    assert_trees_close(other.outcome.collisions, one.outcome.collisions)
    np.testing.assert_array_equal(other.outcome.crossing.passed, one.outcome.crossing.passed)
    np.testing.assert_allclose(
        other.after.drones.body.position_w, one.after.drones.body.position_w * sides[None], atol=1e-4
    )
    end = jax.tree.map(lambda x: jnp.asarray(x[-1]), one.after)
    signs, gates = np.ones(13 + 3 + 4), 3
    signs[[1, 5, 8 + gates + 1, 8 + gates + 3, 13 + gates + 1]] = -1  # y components, and the sine
    seen, reflected = env.observe_as["paper"](end), mirror.observe_as["paper"](mirrored(end))
    np.testing.assert_allclose(reflected, np.asarray(seen) * signs[:, None, None], atol=1e-5)
