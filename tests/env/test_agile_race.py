"""Races of vehicles flown by thrust and body rates: what they see, how they collide, what may differ between them."""

import functools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cruise.config import ObservationKind, Track, Vehicle
from cruise.dynamics import DroneState, FreeBody, Parameters
from cruise.dynamics.quadrotor import Memory
from cruise.env.observation_body import NEAREST, OPPONENT_RANGE, OUTDOORS
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.surroundings import Conditions
from cruise.env.types import RaceState, race_rules
from cruise.presets import TRACKS, VEHICLES
from tests.env.races import before_gate, forward
from tests.helpers import arrays, yaw_matrix

RING, RACER = TRACKS["ring"], VEHICLES["racer"]
OPPONENT_SIZE = 7  # numbers of each opponent
RACES, OWN = 12, 38  # races at random; numbers of the body observation that tell of no opponent
NOTICED = 6.0  # what `body-near` promises: opponents are whole within half of it, gone beyond it [m]
RULES = arrays(race_rules(RACER.agility, 0.25, 0))


@functools.cache
def race_env(drones: int, vehicle: Vehicle = RACER, track: Track = RING, kind: ObservationKind = "body") -> RaceEnv:
    env = make_race_env(track, drones, vehicle, kind)
    reset = jax.jit(env.reset, static_argnums=(1, 2))
    return env._replace(reset=reset, step=jax.jit(env.step), observe=jax.jit(env.observe))


def random_race(drones: int, seed: int = 0, out: float = 0.2) -> RaceState:
    """Drones near each other in any motion and attitude: [..., N, RACES]."""
    rng = np.random.default_rng(seed)
    shape = (drones, RACES)
    attitude = rng.normal(size=(4, *shape))
    body = FreeBody(
        position_w=rng.uniform(-5, 5, (3, *shape)) + np.array([5, 0, 6])[:, None, None],
        velocity_w=rng.uniform(-9, 9, (3, *shape)),
        attitude=attitude / np.linalg.norm(attitude, axis=0),
        angular_velocity_b=rng.uniform(-3, 3, (3, *shape)),
    )
    memory = Memory(rng.uniform(0, 8, (4, *shape)), rng.uniform(-1, 1, (1, 4, *shape)), None)
    drones_state = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), DroneState(body, memory))
    gate, none = jnp.asarray(rng.integers(5, size=shape), jnp.int32), jnp.zeros(shape, bool)
    gone = jnp.asarray(rng.random(shape) < out)
    return RaceState(drones_state, gate, jnp.zeros_like(gate), gone, none, jnp.zeros(RACES, jnp.int32))


def of_drones(state: RaceState, order: list[int]) -> RaceState:
    """The race with some of its drones, listed so."""
    rows = np.array(order)
    body = jax.tree.map(lambda x: x[:, rows], state.drones.body)
    memory = state.drones.memory
    memory = memory._replace(wrench=memory.wrench[:, rows], commands=memory.commands[:, :, rows])
    lists = {name: getattr(state, name)[rows] for name in ("next_gate", "gates_passed", "out", "finished")}
    return state._replace(drones=state.drones._replace(body=body, memory=memory), **lists)


def with_others(state: RaceState, offset: jax.Array) -> RaceState:
    """The race with drones at such offsets from where the first is."""
    body = state.drones.body
    moved = body._replace(position_w=body.position_w[:, :1] + offset)
    return state._replace(drones=state.drones._replace(body=moved))


def matrices(state: RaceState) -> np.ndarray:
    """R_WB [N, E, 3, 3]."""
    q = np.asarray(state.drones.body.attitude)
    return Rotation.from_quat(q.reshape(4, -1).T, scalar_first=True).as_matrix().reshape(*q.shape[1:], 3, 3)


def test_the_corners_of_the_next_two_gates_are_where_they_are() -> None:
    state = random_race(2)
    seen = np.asarray(race_env(2).observe(state))[:24].reshape(8, 3, 2, RACES) * OUTDOORS.corner
    turn, position = matrices(state), np.asarray(state.drones.position_w)
    for ahead in range(2):
        for i in range(2):
            for e in range(RACES):
                gate = RING.gates[(int(state.next_gate[i, e]) + ahead) % 5]
                left = np.array([-np.sin(gate.yaw), np.cos(gate.yaw), 0.0])
                up = np.array([0.0, 0.0, 1.0])
                corners = [
                    np.array(gate.position_w) + a * left + b * up for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
                ]
                own = (np.array(corners) - position[:, i, e]) @ turn[i, e]
                np.testing.assert_allclose(seen[4 * ahead : 4 * ahead + 4, :, i, e], own, atol=1e-4)


def test_own_motion_is_seen_along_the_bodys_axes() -> None:
    state = random_race(2)
    seen, turn = np.asarray(race_env(2).observe(state)), matrices(state)
    velocity = np.einsum("neji,jne->ine", turn, np.asarray(state.drones.velocity_w))
    np.testing.assert_allclose(seen[24:27] * OUTDOORS.speed, velocity, atol=1e-4)
    np.testing.assert_allclose(seen[27:30], turn[:, :, 2].transpose(2, 0, 1), atol=1e-5)
    highest = np.array(RACER.airframe.rates.highest)[:, None, None]
    np.testing.assert_allclose(seen[30:33] * highest, state.drones.angular_velocity_b, atol=1e-4)
    np.testing.assert_array_equal(seen[33:37], state.drones.memory.commands[0])
    np.testing.assert_allclose(seen[37] * 4, state.drones.position_w[2], atol=1e-4)


def test_the_last_action_is_seen() -> None:
    env, state = race_env(2), random_race(2, out=0.0)
    action = jnp.asarray(np.random.default_rng(1).uniform(-1.5, 1.5, (4, 2, RACES)), jnp.float32)
    after, _ = env.step(state, action, RULES)
    flying = np.asarray(after.airborne)
    seen = np.asarray(env.observe(after))[33:37]
    np.testing.assert_allclose(seen[:, flying], np.clip(action, -1, 1)[:, flying], atol=1e-6)


def test_the_size_does_not_depend_on_the_number_of_drones() -> None:
    for drones in (1, 2, 3, 8):
        seen = jax.eval_shape(make_race_env(RING, drones, RACER, "body").observe, random_race(drones))
        assert seen.shape == (OWN + NEAREST * OPPONENT_SIZE, drones, RACES)


def test_the_order_of_opponents_is_not_seen() -> None:
    env, state = race_env(5), random_race(5)
    seen = np.asarray(env.observe(state))
    for order in ([0, 3, 1, 2, 4], [3, 0, 4, 2, 1]):
        np.testing.assert_allclose(np.asarray(env.observe(of_drones(state, order))), seen[:, order], atol=1e-6)


def test_a_field_is_seen_as_a_larger_one_whose_other_drones_are_out() -> None:
    """Who is not there and who is out are the same nobody: zeros."""
    state = random_race(5, out=0.0)
    gone = state._replace(out=jnp.zeros_like(state.out).at[2:].set(True))
    large, small = race_env(5).observe(gone), race_env(2).observe(of_drones(state, [0, 1]))
    np.testing.assert_allclose(np.asarray(large)[:, :2], small, atol=1e-6)
    alone = np.asarray(race_env(1).observe(of_drones(state, [0])))
    assert (alone[OWN:] == 0).all()
    np.testing.assert_allclose(alone[:OWN, 0], np.asarray(small)[:OWN, 0], atol=1e-6)


@pytest.mark.parametrize("kind", ["body", "body-near"])
def test_the_nearest_three_are_seen_nearest_first(kind: ObservationKind) -> None:
    state = random_race(5, out=0.3)
    seen = np.asarray(race_env(5, kind=kind).observe(state))[OWN:].reshape(NEAREST, OPPONENT_SIZE, 5, RACES)
    position, flying = np.asarray(state.drones.position_w), np.asarray(state.airborne)
    turn, velocity = matrices(state), np.asarray(state.drones.velocity_w)
    for i in range(5):
        for e in range(RACES):
            others = [j for j in range(5) if j != i and flying[j, e]]
            others.sort(key=lambda j: np.linalg.norm(position[:, j, e] - position[:, i, e]))
            for slot in range(NEAREST):
                got = seen[slot, :, i, e]
                if slot >= len(others):
                    assert (got == 0).all()
                    continue
                offset, motion = (x[:, others[slot], e] - x[:, i, e] for x in (position, velocity))
                apart = np.linalg.norm(offset)
                fading = np.interp(apart, [NOTICED / 2, NOTICED], [1, 0]) if kind == "body-near" else 1
                expected = np.concatenate(
                    [offset @ turn[i, e] / OPPONENT_RANGE, motion @ turn[i, e] / OUTDOORS.speed, [1]]
                )
                np.testing.assert_allclose(got, np.clip(fading * expected, -3, 3), atol=1e-4)


def test_a_drone_that_leads_by_enough_sees_what_it_would_see_alone() -> None:
    """Whatever the others do: not one number tells it that they are there."""
    state = random_race(3, out=0.0)
    away = jnp.outer(jnp.array([0.6, 0.0, 0.8]), jnp.array([0.0, NOTICED + 0.01, -NOTICED - 0.01]))[..., None]
    apart, near = with_others(state, away), with_others(state, 0.9 * away)
    env = race_env(3, kind="body-near")
    seen = np.asarray(env.observe(apart))[:, 0]
    np.testing.assert_array_equal(seen, np.asarray(race_env(1).observe(of_drones(apart, [0])))[:, 0])
    assert (np.asarray(env.observe(near))[OWN + OPPONENT_SIZE - 1, 0] > 0).all()


def test_every_direction_looks_alike() -> None:
    """World, track and drones turned about z: the same view, and an action means the same."""
    yaw = 2.1
    turn, state = yaw_matrix(yaw), random_race(2)
    gates = tuple(replace(g, position_w=tuple(turn @ g.position_w), yaw=g.yaw + yaw) for g in RING.gates)
    there = race_env(2, RACER, replace(RING, gates=gates))
    body = state.drones.body
    spin = Rotation.from_euler("Z", yaw)
    q = np.asarray(body.attitude)
    turned = (spin * Rotation.from_quat(q.reshape(4, -1).T, scalar_first=True)).as_quat(scalar_first=True)
    moved = body._replace(
        position_w=jnp.asarray(np.einsum("ij,jne->ine", turn, body.position_w), jnp.float32),
        velocity_w=jnp.asarray(np.einsum("ij,jne->ine", turn, body.velocity_w), jnp.float32),
        attitude=jnp.asarray(turned.T.reshape(q.shape), jnp.float32),
    )
    after = there.observe(state._replace(drones=state.drones._replace(body=moved)))
    np.testing.assert_allclose(after, race_env(2).observe(state), atol=1e-5)
    action = jnp.asarray(np.random.default_rng(0).uniform(-1, 1, (4, 2, RACES)), jnp.float32)
    for kind in there.decode_as:
        np.testing.assert_array_equal(there.decode_as[kind](state, action), action)


def test_one_race_is_a_batch_of_races() -> None:
    state = random_race(2)
    one = race_env(2).observe(jax.tree.map(lambda x: x[..., 7], state))
    np.testing.assert_allclose(one, np.asarray(race_env(2).observe(state))[..., 7], atol=1e-6)


def on_its_back(drones: int, spread: np.ndarray, vehicle: Vehicle = RACER) -> RaceState:
    """Drones upside down in one race, `spread` [3, N] about a place before gate 0."""
    state = race_env(drones, vehicle).reset(jax.random.key(0), (), 0)
    place = before_gate(RING, 0, 3.0)[:, None] + spread
    attitude = jnp.zeros((4, drones)).at[1].set(1.0)
    body = state.drones.body._replace(position_w=jnp.asarray(place, jnp.float32), attitude=attitude)
    return state._replace(drones=state.drones._replace(body=body))


def test_flying_upside_down_is_no_crash() -> None:
    state = on_its_back(1, np.zeros((3, 1)))
    action = jnp.zeros((4, 1))
    _, outcome = race_env(1).step(state, action, RULES)
    assert not np.asarray(outcome.terminated).any()
    careful = replace(RACER, flip_ends=True)
    _, outcome = race_env(1, careful).step(state, action, RULES)
    assert np.asarray(outcome.collisions.flip).all()


@pytest.mark.parametrize(("apart", "hit"), [((0.0, 0.2, 0.0), True), ((0.0, 0.0, 0.2), False), ((0.0, 0.0, 0.1), True)])
def test_drones_collide_in_their_ellipsoid(apart: tuple[float, float, float], hit: bool) -> None:
    """0.25 m wide and half as high."""
    flat = replace(RACER, collision_aspect=0.5)
    spread = np.stack([np.zeros(3), np.array(apart)], axis=1)
    _, outcome = race_env(2, flat).step(on_its_back(2, spread), jnp.zeros((4, 2)), RULES)
    np.testing.assert_array_equal(outcome.collisions.drone, [hit, hit])


def test_downwash_is_felt_in_a_race_by_who_is_in_the_air() -> None:
    blown = replace(RACER, airframe=replace(RACER.airframe, downwash=True))
    env = race_env(2, blown)
    state = env.reset(jax.random.key(0), (), 0)
    above = before_gate(RING, 0, 3.0)
    place = np.stack([above, above - np.array([0, 0, 1.0])], axis=1)
    body = state.drones.body._replace(position_w=jnp.asarray(place, jnp.float32))
    state = state._replace(drones=state.drones._replace(body=body))
    hover = jnp.zeros((4, 2)).at[0].set(2 * 9.81 / RACER.agility - 1)
    sinking = {}
    for gone in (False, True):
        after, _ = env.step(state._replace(out=jnp.array([gone, False])), hover, RULES)
        sinking[gone] = -float(after.drones.velocity_w[2, 1])
    assert sinking[False] > 0.05
    assert abs(sinking[True]) < 1e-4


def test_races_may_begin_with_drones_that_differ() -> None:
    """What `perturb` draws is new for every drone of every race, stays with it, and decides how it flies."""

    def heavier(key: jax.Array, shape: tuple[int, ...]) -> Conditions:
        return Conditions(Parameters(mass=RACER.mass * jax.random.uniform(key, shape, minval=1.0, maxval=1.5)))

    env = make_race_env(RING, 2, RACER, "body", perturb=heavier)
    state = jax.jit(env.reset, static_argnums=1)(jax.random.key(4), (RACES,))
    usual = race_env(2).reset(jax.random.key(4), (RACES,))
    np.testing.assert_array_equal(state.drones.position_w, usual.drones.position_w)
    mass = np.asarray(state.drones.parameters.mass)
    assert len(np.unique(mass)) == 2 * RACES
    hover = jnp.zeros((4, 2, RACES)).at[0].set(2 * 9.81 / RACER.agility - 1)
    after, _ = jax.jit(env.step)(state, hover, RULES)
    np.testing.assert_array_equal(after.drones.parameters.mass, mass)
    np.testing.assert_allclose(after.drones.velocity_w[2], -9.81 * 0.02 * (1 - RACER.mass / mass), atol=2e-3)


def test_a_step_at_racing_speed_passes_its_gate_and_moves_on() -> None:
    env = race_env(1)
    state = env.reset(jax.random.key(0), (), 2)
    body = state.drones.body._replace(
        position_w=jnp.asarray(before_gate(RING, 2, 0.1)[:, None], jnp.float32),
        velocity_w=jnp.asarray(17.0 * forward(RING, 2)[:, None], jnp.float32),
    )
    after, outcome = env.step(state._replace(drones=state.drones._replace(body=body)), jnp.zeros((4, 1)), RULES)
    assert bool(outcome.crossing.passed[0])
    assert 0.2 < float(outcome.crossing.fraction[0]) < 0.4
    assert int(after.next_gate[0]) == 3
