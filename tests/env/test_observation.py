"""What a drone sees: the paper's vector against an independent transcription, and the laws of the extended one."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Track
from cruise.env.types import RaceState
from tests.env import paper_reference as paper
from tests.env.races import EIGHT, RANDOM_RACES, RING, race_env, random_race
from tests.helpers import random_track, yaw_matrix


def permuted(state: RaceState, order: list[int]) -> RaceState:
    """The same race with its drones listed in another order."""
    drones = jax.tree.map(lambda x: x[:, np.array(order)], state.drones)
    lists = {k: getattr(state, k)[np.array(order)] for k in ("next_gate", "gates_passed", "out", "finished")}
    return state._replace(drones=drones, **lists)


@pytest.mark.parametrize(("track", "drones"), [(RING, 1), (RING, 4), (EIGHT, 2), (random_track(8), 6)])
def test_paper_observation_is_the_papers(track: Track, drones: int) -> None:
    env = race_env(drones, track)
    state = random_race(env, spread=9.0)
    seen = np.asarray(env.observe_as["paper"](state))
    assert seen.shape == (13 + len(track.gates) + 4 * (drones - 1), drones, RANDOM_RACES)
    assert np.abs(seen).max() == 1
    body = state.drones.body
    for e in range(0, RANDOM_RACES, 4):
        race = {"p": body.position_w, "v": body.velocity_w, "euler": body.euler}
        race = {k: np.asarray(v)[..., e].astype(np.float64) for k, v in race.items()}
        race |= {"target": np.asarray(state.next_gate)[:, e], "flying": np.asarray(state.airborne)[:, e]}
        for i in range(drones):
            np.testing.assert_allclose(seen[:, i, e], paper.observation(track, i, race), atol=2e-6)


def test_paper_observation_is_clipped_to_one() -> None:
    env = race_env(4)
    seen = np.asarray(env.observe_as["paper"](random_race(env, spread=40.0)))
    assert seen.min() == -1
    assert seen.max() == 1


def test_extended_observation_is_bounded_and_grows_evenly_with_opponents() -> None:
    sizes = []
    for drones in (1, 2, 4):
        env = race_env(drones)
        seen = np.asarray(env.observe(random_race(env, spread=30.0)))
        assert seen.shape[1:] == (drones, RANDOM_RACES)
        assert np.isfinite(seen).all()
        assert np.abs(seen).max() <= 3
        sizes.append(seen.shape[0])
    assert sizes[2] - sizes[0] == 3 * (sizes[1] - sizes[0])


@pytest.mark.parametrize("order", [[0, 2, 1, 3], [0, 3, 2, 1], [0, 3, 1, 2]])
def test_extended_observation_knows_no_order_of_opponents(order: list[int]) -> None:
    """Opponents listed otherwise, with their whole state: the ego sees the same; and everybody keeps their view."""
    env = race_env(4)
    state = random_race(env, out=0.3)
    observe = env.observe_as["extended"]
    before, after = np.asarray(observe(state)), np.asarray(observe(permuted(state, order)))
    np.testing.assert_allclose(after[:, 0], before[:, 0], atol=1e-6)
    np.testing.assert_allclose(after, before[:, order], atol=1e-6)


def opponents_seen(drones: int, state: RaceState) -> np.ndarray:
    """The part of the extended observation that tells of opponents: [slot, feature, N, E]."""
    seen, alone = np.asarray(race_env(drones).observe(state)), race_env(1)
    own = alone.observe(random_race(alone)).shape[0]
    return seen[own:].reshape(drones - 1, -1, drones, seen.shape[2])


def test_absent_opponents_are_zeros_behind_the_others() -> None:
    state = random_race(race_env(4), out=0.4, spread=4.0)
    seen, flying = opponents_seen(4, state), np.asarray(state.airborne)
    position = np.asarray(state.drones.position_w)
    assert (~flying).any()
    for i in range(4):
        near = np.linalg.norm(position - position[:, i : i + 1], axis=0) < 5
        present = np.delete(flying & near, i, axis=0).sum(axis=0)
        assert len(np.unique(present)) == 4
        for slot in range(3):
            assert (seen[slot, :, i][:, present <= slot] == 0).all()
            assert (np.abs(seen[slot, :, i][:, present > slot]).max(axis=0) > 0).all()


@pytest.mark.parametrize("drones", [4, 9])
def test_opponents_are_listed_nearest_first_and_fade_with_distance(drones: int) -> None:
    """Relative position leads each slot; in a small field none of it is clipped. Whole up to 2.5 m, gone at 5 m."""
    env = race_env(drones)
    state = random_race(env, out=0.0, spread=1.5)
    position = np.asarray(state.drones.position_w)
    seen = np.linalg.norm(opponents_seen(drones, state)[:, :3], axis=1)
    for i in range(drones):
        distance = np.linalg.norm(np.delete(position, i, axis=1) - position[:, i : i + 1], axis=0)
        distance = np.sort(distance, axis=0)
        assert ((distance < 2.5).any(), (distance > 5).any()) == (True, True)
        expected = distance * np.interp(distance, [2.5, 5.0], [1.0, 0.0])
        np.testing.assert_allclose(seen[:, i] * 3.0, expected, rtol=1e-4, atol=1e-5)


def test_who_is_far_away_might_as_well_not_be_there() -> None:
    """What a drone sees of a race in which everybody else is more than 5 m off is what it sees alone."""
    env, alone = race_env(4), race_env(1)
    state = random_race(env, out=0.0, spread=30.0)
    position = np.asarray(state.drones.position_w)
    apart = np.linalg.norm(position[:, 1:] - position[:, :1], axis=0).min(axis=0)
    seen = np.asarray(env.observe(state))[:, 0]
    own = seen.shape[0] - opponents_seen(4, state).shape[0] * opponents_seen(4, state).shape[1]
    assert own == alone.observe(random_race(alone)).shape[0]
    assert (apart > 5).mean() > 0.3
    assert (seen[own:, apart > 5] == 0).all()
    assert (np.abs(seen[own:, apart < 4.9]).max(axis=0) > 0).all()


@pytest.mark.parametrize("kind", ["paper", "extended"])
def test_where_an_absent_opponent_lies_cannot_be_seen(kind: str) -> None:
    env = race_env(4)
    state = random_race(env, out=0.4)
    gone = ~np.asarray(state.airborne)
    body = state.drones.body
    elsewhere = body._replace(position_w=body.position_w + 3.0 * gone, velocity_w=body.velocity_w - 2.0 * gone)
    moved = state._replace(drones=state.drones._replace(body=elsewhere))
    before, after = (np.asarray(env.observe_as[kind](s)) for s in (state, moved))
    np.testing.assert_array_equal(before[:, ~gone], after[:, ~gone])


def test_extended_observation_sees_opponents_velocities_and_the_own_attitude() -> None:
    """The paper's does not."""
    env = race_env(2)
    state = random_race(env, out=0.0, spread=2.0, speed=2.0)
    body = state.drones.body
    near = np.linalg.norm(np.diff(np.asarray(body.position_w), axis=1)[:, 0], axis=0) < 4.9
    assert near.any()

    def seen(kind: str, **changes: np.ndarray) -> np.ndarray:
        changed = state._replace(drones=state.drones._replace(body=body._replace(**changes)))
        return np.asarray(env.observe_as[kind](changed))[:, 0, near]  # of drone 0

    others = np.array([0.0, 0.5])[None, :, None]
    for change in (
        {"velocity_w": body.velocity_w + others},
        {"euler": body.euler + np.array([0.1, 0.1, 0])[:, None, None]},
        {"angular_velocity_b": body.angular_velocity_b + 0.3},
    ):
        np.testing.assert_array_equal(seen("paper", **change), seen("paper"))
        assert (seen("extended", **change) != seen("extended")).any(axis=0).all()


def test_extended_observation_sees_the_gate_after_the_next() -> None:
    gates = list(RING.gates)
    gates[2] = replace(gates[2], position_w=(-7.0, 5.0, 4.5))
    other = replace(RING, gates=tuple(gates))
    envs, first = (race_env(2), race_env(2, other)), jnp.zeros((2, RANDOM_RACES), jnp.int32)
    for kind, sees in (("paper", False), ("extended", True)):
        races = (random_race(env)._replace(next_gate=first) for env in envs)
        here, there = (env.observe_as[kind](race) for env, race in zip(envs, races, strict=True))
        assert (np.asarray(here) != np.asarray(there)).any(axis=0).all() == sees


def turned(track: Track, yaw: float, shift: np.ndarray) -> Track:
    """The track turned about z and moved."""
    turn = yaw_matrix(yaw)
    gates = tuple(replace(g, position_w=tuple(turn @ g.position_w + shift), yaw=g.yaw + yaw) for g in track.gates)
    return replace(track, gates=gates)


def test_to_the_extended_observation_every_direction_looks_alike() -> None:
    """World, drones and track turned about z and moved sideways: the same view, and a policy's action turns along."""
    yaw, shift = -2.4, np.array([3.0, -4.0, 0.0])
    turn, here, there = yaw_matrix(yaw), race_env(2), race_env(2, turned(RING, yaw, shift))
    state = random_race(here)
    body, moved_body = state.drones.body, {}
    for name in ("position_w", "velocity_w"):
        moved_body[name] = jnp.asarray(np.einsum("ij,jne->ine", turn, getattr(body, name)), jnp.float32)
    moved_body["position_w"] += shift[:, None, None]
    moved_body["euler"] = body.euler + jnp.array([0, 0, yaw])[:, None, None]
    moved = state._replace(drones=state.drones._replace(body=body._replace(**moved_body)))
    np.testing.assert_allclose(there.observe(moved), here.observe(state), atol=1e-5)

    action = jnp.asarray(np.random.default_rng(1).uniform(-1, 1, (3, 2, RANDOM_RACES)), jnp.float32)
    ours, theirs = (
        here.decode_as["extended"](state, action),
        there.decode_as["extended"](moved, action),
    )
    np.testing.assert_allclose(theirs, np.einsum("ij,jne->ine", turn, ours), atol=1e-5)
    np.testing.assert_array_equal(here.decode_as["paper"](state, action), action)


def test_a_policy_on_the_extended_observation_speaks_in_the_gates_frame() -> None:
    """Forward is through the gate, whichever it is; lengths and heights are kept."""
    env = race_env(1, EIGHT)
    gate, forward = jnp.arange(6)[None], jnp.zeros((3, 1, 6)).at[0].set(1.0)
    normals = [[np.cos(g.yaw), np.sin(g.yaw), 0.0] for g in EIGHT.gates]
    state = env.reset(jax.random.key(0), (6,))._replace(next_gate=gate)
    np.testing.assert_allclose(env.decode_as["extended"](state, forward)[:, 0], np.transpose(normals), atol=1e-6)
    action = jnp.asarray(np.random.default_rng(2).uniform(-1, 1, (3, 1, 6)), jnp.float32)
    world = np.asarray(env.decode_as["extended"](state, action))
    np.testing.assert_allclose(np.linalg.norm(world, axis=0), np.linalg.norm(action, axis=0), rtol=1e-5)
    np.testing.assert_array_equal(world[2], action[2])


@pytest.mark.parametrize("kind", ["paper", "extended"])
def test_one_race_is_a_batch_of_races(kind: str) -> None:
    env = race_env(4)
    state = random_race(env)
    many = np.asarray(env.observe_as[kind](state))
    one = env.observe_as[kind](jax.tree.map(lambda x: x[..., 7], state))
    np.testing.assert_allclose(one, many[..., 7], atol=1e-6)
