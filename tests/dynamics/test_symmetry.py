"""Symmetries of flight, and what must not depend on how drones are batched or whether code is compiled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.dynamics import DroneState, RigidBody, make_dynamics
from cruise.presets import VEHICLES
from tests.dynamics.bodies import UNEVEN, at_rest, body, fly, integrate, smooth_actions, wrench
from tests.dynamics.paper_reference import body_to_world
from tests.helpers import assert_trees_close, yaw_matrix

VEHICLE = VEHICLES["paper"]
MIRROR = np.float32([1, -1, 1])  # of vectors, in the x-z plane
TURN = np.float32([-1, 1, -1])  # of axial vectors: roll, pitch, yaw and body rates


def mirrored(state: DroneState, axis: int) -> DroneState:
    """The state seen in a mirror in the x-z plane; `axis` is the one of the components."""
    shape = [1] * state.memory.ndim
    shape[axis] = 3
    vector, axial = MIRROR.reshape(shape), TURN.reshape(shape)
    position, velocity, euler, rates = state.body
    flipped = RigidBody(position * vector, velocity * vector, euler * axial, rates * axial)
    return DroneState(flipped, state.memory * vector)


def random_state(count: int, seed: int = 0) -> DroneState:
    """Drones in motion, [3, count]."""
    rng = np.random.default_rng(seed)
    start = np.array([[0], [0], [20.0]]) + rng.uniform(-2, 2, (3, count))
    parts = [start, *(rng.uniform(-s, s, (3, count)) for s in (3, 0.5, 1))]
    memory = jnp.asarray(rng.uniform(-0.5, 0.5, (3, count)))
    return jax.tree.map(lambda x: x.astype(jnp.float32), DroneState(body(*parts), memory))


def random_actions(count: int, steps: int = 30) -> np.ndarray:
    return smooth_actions(np.random.default_rng(1), steps, count).astype(np.float32)


def test_mirror_in_the_x_z_plane() -> None:
    state, actions = random_state(8), random_actions(8)
    flown = fly(VEHICLE, state, actions, 7.5)
    reflected = fly(VEHICLE, mirrored(state, axis=0), actions * MIRROR[None, :, None], 7.5)
    assert np.abs(np.asarray(flown.body.position_w)[:, 1]).max() > 1
    assert_trees_close(reflected, mirrored(flown, axis=1), atol=1e-5)


def test_translation_changes_nothing_else() -> None:
    state, actions = random_state(8), random_actions(8)
    shift = np.float32([4.0, -8.0, 2.0])[:, None]
    moved = state._replace(body=state.body._replace(position_w=state.position_w + shift))
    flown, shifted = fly(VEHICLE, state, actions, 7.5), fly(VEHICLE, moved, actions, 7.5)
    back = shifted._replace(body=shifted.body._replace(position_w=shifted.body.position_w - shift))
    assert_trees_close(back, flown, atol=2e-5)


@pytest.mark.parametrize("yaw", [0.7, -2.5])
def test_the_rigid_body_knows_no_north(yaw: float) -> None:
    """A world turned about z: same roll, pitch and body rates, everything else turned along."""
    turn = yaw_matrix(yaw)
    p, v, e, w = np.float64([[1, 2, 9], [2, -1, 0.5], [0.2, -0.3, 0.4], [0.8, -0.5, 1.0]])
    push = wrench(8.0, (4e-3, -6e-3, 2e-3))
    with jax.enable_x64(True):
        end = integrate(UNEVEN, "rk4", body(p, v, e, w), push, 0.8, 100)
        turned = integrate(UNEVEN, "rk4", body(turn @ p, turn @ v, e + np.array([0, 0, yaw]), w), push, 0.8, 100)
        np.testing.assert_allclose(turned.position_w, turn @ np.asarray(end.position_w), atol=1e-6)
        np.testing.assert_allclose(turned.velocity_w, turn @ np.asarray(end.velocity_w), atol=1e-6)
        np.testing.assert_allclose(turned.euler[:2], end.euler[:2], atol=1e-6)
        np.testing.assert_allclose(turned.angular_velocity_b, end.angular_velocity_b, atol=1e-6)
        attitude = turn @ body_to_world(np.asarray(end.euler))
        np.testing.assert_allclose(body_to_world(np.asarray(turned.euler)), attitude, atol=1e-6)


def test_the_cascade_flies_alike_along_x_and_y() -> None:
    """Four drones with one sideways command, turned by quarter turns: the same flight in four directions."""
    steps = 60
    along, up = random_actions(1, steps)[:, 0, 0], random_actions(2, steps)[:, 2, 1]
    quarters = [np.rint(yaw_matrix(k * np.pi / 2)) for k in range(4)]
    command = np.stack([along, np.zeros(steps), up])
    actions = np.stack([q @ command for q in quarters], axis=-1).transpose(1, 0, 2).astype(np.float32)
    start = np.tile(np.float32([[0.0], [0.0], [15.0]]), (1, 4))
    flown = np.asarray(fly(VEHICLE, at_rest(VEHICLE, start), actions, 7.5).body.position_w)
    assert np.abs(flown[:, 0, 0]).max() > 0.5
    for k, q in enumerate(quarters):
        np.testing.assert_allclose(flown[:, :, k], flown[:, :, 0] @ q.T.astype(np.float32), atol=1e-5)


def test_one_drone_is_a_batch_of_drones() -> None:
    """B = (), (N,) and (N, E) give the same drones."""
    state, actions = random_state(6), random_actions(6)
    many = fly(VEHICLE, state, actions, 6.0)
    grid = fly(VEHICLE, jax.tree.map(lambda x: x.reshape(3, 2, 3), state), actions.reshape(-1, 3, 2, 3), 6.0)
    assert_trees_close(jax.tree.map(lambda x: x.reshape(-1, 3, 6), grid), many, atol=1e-5)
    one = fly(VEHICLE, jax.tree.map(lambda x: x[:, 4], state), actions[:, :, 4], 6.0)
    assert_trees_close(one, jax.tree.map(lambda x: x[:, :, 4], many), atol=1e-5)


def test_compiled_equals_interpreted() -> None:
    dynamics, state, action = make_dynamics(VEHICLE), random_state(6), jnp.asarray(random_actions(6)[0])
    agility = jnp.float32(6.0)
    compiled = jax.jit(dynamics.step)(state, action, agility)
    with jax.disable_jit():
        interpreted = dynamics.step(state, action, agility)
    assert_trees_close(compiled, interpreted, atol=1e-6)


def test_agility_may_differ_from_drone_to_drone() -> None:
    state, action = random_state(3), random_actions(3)[0]
    step = jax.jit(make_dynamics(VEHICLE).step)
    together = step(state, action, jnp.float32([2.0, 4.0, 7.5]))
    for k, agility in enumerate((2.0, 4.0, 7.5)):
        alone = step(jax.tree.map(lambda x, k=k: x[:, k], state), action[:, k], jnp.float32(agility))
        assert_trees_close(jax.tree.map(lambda x, k=k: x[:, k], together), alone, atol=1e-6)


def test_proprioception_turns_with_the_world() -> None:
    """What a drone feels of itself are world vectors of order one: turned about z, they turn; the first is up."""
    dynamics, state, yaw = make_dynamics(VEHICLE), random_state(50), 1.2
    turn = yaw_matrix(yaw)
    euler = state.body.euler + jnp.array([0, 0, yaw])[:, None]
    turned = DroneState(state.body._replace(euler=euler), jnp.asarray(turn @ np.asarray(state.memory), jnp.float32))
    felt, felt_turned = ([t.fn(s) / t.scale for t in dynamics.proprioception] for s in (state, turned))
    for vector, vector_turned in zip(felt, felt_turned, strict=True):
        assert vector.shape == (3, 50)
        np.testing.assert_allclose(vector_turned, turn @ np.asarray(vector), atol=1e-6)
        assert 0.01 < np.abs(vector).max() < 3
    up = [body_to_world(e)[:, 2] for e in np.asarray(state.body.euler).T]
    np.testing.assert_allclose(felt[0], np.transpose(up), atol=1e-6)
    np.testing.assert_array_equal(dynamics.euler(state), state.body.euler)
