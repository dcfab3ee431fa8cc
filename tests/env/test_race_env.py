"""The rules of a race: gates, crashes, finishes, and who is still in the air."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Track
from cruise.env.types import RaceState, StepOutcome
from cruise.presets import CURRICULUM, REWARDS
from tests.env.races import EIGHT, RING, before_gate, forward, lined_up, race_env, real_rules, rules_of, state_of


def idle(state: RaceState) -> jax.Array:
    return jnp.zeros_like(state.drones.body.position_w)


def at_gate(track: Track, gate: int, drones: int, **shift: float) -> tuple[np.ndarray, np.ndarray]:
    """Drone 0 about to fly through a gate at 5 m/s, the others hovering far above it: position and velocity [3, N]."""
    position = np.stack([before_gate(track, gate, 3.0, up=2.5 + k) for k in range(drones)], axis=1)
    position[:, 0] = before_gate(track, gate, 0.2, **shift)
    velocity = np.zeros((3, drones))
    velocity[:, 0] = 5.0 * forward(track, gate)
    return position, velocity


def two_drones(distance: float, **fields: object) -> tuple[RaceState, StepOutcome, RaceState]:
    """Two drones at rest before gate 0, `distance` apart, through a step of the last stage: before, outcome, after."""
    env = race_env(2)
    position = np.stack([before_gate(RING, 0, 2.0, left=side * distance / 2) for side in (-1, 1)], axis=1)
    state = state_of(env, position, **fields)
    after, outcome = env.step(state, idle(state), rules_of())
    return state, outcome, after


@pytest.mark.parametrize("track", [RING, EIGHT], ids=lambda t: t.name)
def test_gates_are_flown_in_order_lap_after_lap(track: Track) -> None:
    """Passing the target advances it modulo G; flying through any other gate does not."""
    env, count = race_env(2, track), len(track.gates)
    for gates_passed in range(count + 2):
        target = gates_passed % count
        for flown in ((target + 2) % count, target):
            position, velocity = at_gate(track, flown, 2)
            state = state_of(env, position, velocity, next_gate=target, gates_passed=gates_passed)
            after, outcome = env.step(state, idle(state), rules_of())
            assert list(np.asarray(outcome.crossing.passed)) == [flown == target, False]
            assert int(after.next_gate[0]) == (target + (flown == target)) % count
            assert int(after.gates_passed[0]) == gates_passed + (flown == target)
            assert int(after.next_gate[1]) == target


def test_a_passed_gate_pays_one_with_the_printed_weights() -> None:
    env = race_env(2, RING, REWARDS["paper"])
    position, velocity = at_gate(RING, 3, 2)
    state = state_of(env, position, velocity, next_gate=3)
    _, outcome = env.step(state, idle(state), rules_of())
    assert float(outcome.reward[0]) == 1.0


def test_flying_through_backwards_passes_nothing() -> None:
    env = race_env(2)
    position, velocity = at_gate(RING, 1, 2)
    position[:, 0] = before_gate(RING, 1, -0.2)
    state = state_of(env, position, -velocity, next_gate=1)
    after, outcome = env.step(state, idle(state), rules_of())
    assert not np.asarray(outcome.crossing.passed).any()
    assert int(after.next_gate[0]) == 1


@pytest.mark.parametrize("stage", CURRICULUM, ids=lambda s: s.name)
def test_collisions_end_the_episode_from_stage_four(stage: object) -> None:
    """Against a drone, the ground and a gate's frame alike; in earlier stages the drone flies on."""
    env = race_env(2)
    rules, terminal = rules_of(stage), CURRICULUM.index(stage) >= 3
    near = np.stack([before_gate(RING, 0, 2.0), before_gate(RING, 0, 2.0, left=0.3)], axis=1)
    frame, fast = at_gate(RING, 0, 2, left=1.0 + stage.gate_tolerance + 0.15)
    low = np.array([[10.0, 10.0], [-1.0, 1.0], [0.2, 3.0]])
    falling = np.array([[0, 0], [0, 0], [-5.0, 0]])
    for kind, position, velocity in (("drone", near, 0.0), ("gate_frame", frame, fast), ("ground", low, falling)):
        state = state_of(env, position, velocity)
        after, outcome = env.step(state, idle(state), rules)
        hit = np.asarray(getattr(outcome.collisions, kind))
        assert hit[0], kind
        np.testing.assert_array_equal(outcome.terminated, hit & terminal)
        np.testing.assert_array_equal(after.out, hit & terminal)
        if stage.collision_penalty:
            np.testing.assert_allclose(np.asarray(outcome.components["coll"])[0], -stage.w_coll, rtol=1e-6)
        if terminal:
            assert float(outcome.reward[0]) == REWARDS["default"].terminal


@pytest.mark.parametrize("preset", REWARDS)
@pytest.mark.parametrize("stage", CURRICULUM, ids=lambda s: s.name)
def test_leaving_or_flipping_ends_the_episode_in_every_stage(stage: object, preset: str) -> None:
    """Drone 0 flies past the bounds or lies on its side; drone 1 flies on."""
    env, nothing = race_env(2, RING, REWARDS[preset]), np.zeros((3, 2))
    steady = np.array([[10.0, 10.0], [0.0, 3.0], [5.0, 4.0]])
    edge, fast, side = steady.copy(), nothing.copy(), nothing.copy()
    edge[0, 0], fast[0, 0], side[0, 0] = 19.95, 9.0, 1.6
    for kind, position, velocity, euler in (("bounds", edge, fast, nothing), ("flip", steady, nothing, side)):
        state = state_of(env, position, velocity, euler=euler)
        after, outcome = env.step(state, idle(state), rules_of(stage))
        for name, hit in outcome.collisions._asdict().items():
            np.testing.assert_array_equal(hit, [name == kind, False])
        np.testing.assert_array_equal(outcome.terminated, [True, False])
        np.testing.assert_array_equal(after.airborne, [False, True])
        assert float(outcome.reward[0]) == REWARDS[preset].terminal
    assert REWARDS["paper"].terminal == -1.0


def test_collision_distance_is_the_rules() -> None:
    for distance, hit in ((0.49, True), (0.51, False)):
        _, outcome, _ = two_drones(distance)
        assert np.asarray(outcome.collisions.drone).all() == hit


@pytest.mark.parametrize("gone", ["out", "finished"])
def test_who_has_left_the_air_is_frozen_and_obstructs_nobody(gone: str) -> None:
    """A drone that crashed or finished meets no one, moves no more, and earns nothing."""
    before, outcome, after = two_drones(0.1, **{gone: np.array([False, True])})
    assert not np.asarray(outcome.collisions.drone).any()
    assert not np.asarray(outcome.terminated).any()
    assert float(outcome.reward[1]) == 0.0
    assert bool(after.airborne[0])
    for now, then in zip(jax.tree.leaves(before.drones), jax.tree.leaves(after.drones), strict=True):
        np.testing.assert_array_equal(now[:, 1], then[:, 1])
    np.testing.assert_array_equal(getattr(after, gone), getattr(before, gone))
    both, collided, _ = two_drones(0.1)
    assert np.asarray(both.airborne).all()
    assert np.asarray(collided.collisions.drone).all()


def test_a_wreck_crashes_only_once() -> None:
    """Lying on the ground, outside the bounds, on its back: for a drone that is out, all that is over."""
    env = race_env(2)
    position = np.array([[25.0, 10.0], [0.0, 0.0], [0.0, 4.0]])
    euler = np.array([[3.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    for gone in (True, False):
        state = state_of(env, position, euler=euler, out=np.array([gone, False]))
        _, outcome = env.step(state, idle(state), rules_of())
        for kind in ("ground", "bounds", "flip"):
            np.testing.assert_array_equal(getattr(outcome.collisions, kind), [not gone, False])
        np.testing.assert_array_equal(outcome.terminated, [not gone, False])
        assert (float(outcome.reward[0]) == 0.0) == gone


def test_finishing_is_no_crash() -> None:
    """The last gate finishes the race: reward of the gate, out of the air, not terminated, frozen from then on."""
    env = race_env(2)
    position, velocity = at_gate(RING, 4, 2)
    state = state_of(env, position, velocity, next_gate=4, gates_passed=14)
    for gates_to_finish, finishes in ((15, True), (16, False), (0, False)):
        rules = real_rules(gates_to_finish=gates_to_finish)
        after, outcome = env.step(state, idle(state), rules)
        np.testing.assert_array_equal(after.finished, [finishes, False])
        np.testing.assert_array_equal(after.airborne, [not finishes, True])
        assert not np.asarray(outcome.terminated).any()
        later, outcome = env.step(after, jnp.ones_like(idle(after)), rules)
        still = np.asarray(later.drones.body.position_w == after.drones.body.position_w).all(axis=0)
        np.testing.assert_array_equal(still[0], finishes)
        assert (float(outcome.reward[0]) == 0.0) == finishes


def test_crashing_in_the_last_gate_is_no_finish() -> None:
    """Two drones through the last gate side by side, too close: both are out, none has finished."""
    env = race_env(2)
    position = np.stack([before_gate(RING, 4, 0.2, left=left) for left in (-0.1, 0.1)], axis=1)
    velocity = np.tile(5.0 * forward(RING, 4)[:, None], (1, 2))
    state = state_of(env, position, velocity, next_gate=4, gates_passed=14)
    after, outcome = env.step(state, idle(state), real_rules(gates_to_finish=15))
    assert not np.asarray(outcome.crossing.passed).any()  # they touched before it
    assert np.asarray(after.out).all()
    assert not np.asarray(after.finished).any()


def test_drones_that_fly_through_each_other_collide() -> None:
    """Fast and head-on, apart before and after the step."""
    env = race_env(2)
    middle, left = before_gate(RING, 0, 2.0), np.cross([0, 0, 1], forward(RING, 0))
    position = np.stack([middle - 1.2 * left, middle + 1.2 * left], axis=1)
    velocity = np.stack([24 * left, -24 * left], axis=1)
    state = state_of(env, position, velocity)
    _, outcome = env.step(state, idle(state), rules_of())
    assert np.asarray(outcome.collisions.drone).all()


def test_time_alone_ends_nothing() -> None:
    """A drone that hovers is never terminated: the time limit belongs to the caller, the clock to the state."""
    env, steps = race_env(1), 2000
    state = lined_up(env, RING, 3)
    rules = rules_of()

    def advance(now: RaceState, _: None) -> tuple[RaceState, jax.Array]:
        then, outcome = env.step.__wrapped__(now, idle(now), rules)
        return then, outcome.terminated

    end, terminated = jax.jit(lambda s: jax.lax.scan(advance, s, length=steps))(state)
    assert not np.asarray(terminated).any()
    np.testing.assert_array_equal(end.step, steps)
    np.testing.assert_array_equal(end.drones.body.position_w, state.drones.body.position_w)
