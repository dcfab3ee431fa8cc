"""Races for the tests of the environment: compiled once per setting, states from plain arrays, a simple pilot."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import RewardWeights, Stage, Track
from cruise.dynamics import DroneState, RigidBody
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.types import RaceState, Rules, StepOutcome, race_rules, stage_rules
from cruise.presets import CURRICULUM, REWARDS, TRACKS, VEHICLES
from cruise.racing.course import Course
from tests.helpers import arrays

RING, EIGHT, PAPER = TRACKS["ring"], TRACKS["figure-eight"], VEHICLES["paper"]
RANDOM_RACES = 100


@functools.cache
def race_env(drones: int, track: Track = RING, reward: RewardWeights = REWARDS["default"]) -> RaceEnv:
    """An environment of the paper's vehicle with compiled functions."""
    env = make_race_env(track, drones, PAPER, reward=reward)
    reset = jax.jit(env.reset, static_argnames=("batch", "gate"))
    observe_as = {kind: jax.jit(function) for kind, function in env.observe_as.items()}
    decode_as = {kind: jax.jit(function) for kind, function in env.decode_as.items()}
    env = env._replace(reset=reset, step=jax.jit(env.step), observe_as=observe_as, decode_as=decode_as)
    return env._replace(observe=observe_as["extended"], decode=decode_as["extended"])


def rules_of(stage: Stage = CURRICULUM[-1], collision_distance: float = 0.5, **changes: float) -> Rules:
    """A stage's rules as arrays, some of them changed."""
    return arrays(stage_rules(stage, collision_distance)._replace(**changes))


def real_rules(agility: float = 7.5, gates_to_finish: int = 0) -> Rules:
    """The rules of an evaluation race as arrays."""
    return arrays(race_rules(agility, 0.25, gates_to_finish))


def state_of(env: RaceEnv, position: np.ndarray, velocity: np.ndarray | float = 0.0, **fields: np.ndarray) -> RaceState:
    """A race from positions and velocities [3, N, *B]; `fields` are those of `RaceState`, and `euler`."""
    shape = np.shape(position)

    def full(value: np.ndarray | float, kind: type, size: tuple[int, ...]) -> jax.Array:
        return jnp.asarray(np.broadcast_to(np.asarray(value, kind), size))

    vectors = (position, velocity, fields.pop("euler", 0.0), 0.0)
    body = RigidBody(*(full(v, np.float32, shape) for v in vectors))
    kinds = {"next_gate": np.int32, "gates_passed": np.int32, "out": bool, "finished": bool}
    parts = {name: full(fields.pop(name, 0), kind, shape[1:]) for name, kind in kinds.items()}
    assert not fields, f"not part of a race: {sorted(fields)}"
    drones = DroneState(body, memory=full(0.0, np.float32, shape))
    assert env.num_drones == shape[1]
    return RaceState(drones, **parts, step=full(0, np.int32, shape[2:]))


def random_race(env: RaceEnv, spread: float = 12.0, speed: float = 8.0, out: float = 0.2) -> RaceState:
    """Drones anywhere, in any motion and attitude, some of them out: [3, N, RANDOM_RACES]."""
    rng = np.random.default_rng(0)
    shape = (3, env.num_drones, RANDOM_RACES)
    position = rng.uniform(-spread, spread, shape)
    position[2] = rng.uniform(0.5, 8, shape[1:])
    euler = rng.uniform(-1, 1, shape) * np.array([1.0, 1.0, np.pi])[:, None, None]
    gate = rng.integers(env.course.num_gates, size=shape[1:])
    gone = rng.random(shape[1:]) < out
    return state_of(env, position, rng.uniform(-speed, speed, shape), euler=euler, next_gate=gate, out=gone)


def before_gate(track: Track, gate: int, distance: float, left: float = 0.0, up: float = 0.0) -> np.ndarray:
    """A point `distance` before the plane of a gate, [3]."""
    ahead = forward(track, gate)
    sideways = np.array([-ahead[1], ahead[0], 0.0])
    return track.gates[gate].position_w - distance * ahead + left * sideways + np.array([0, 0, up])


def forward(track: Track, gate: int) -> np.ndarray:
    """Direction of flight through a gate, [3]."""
    yaw = track.gates[gate].yaw
    return np.array([np.cos(yaw), np.sin(yaw), 0.0])


def lined_up(env: RaceEnv, track: Track, races: int) -> RaceState:
    """Drones at rest, side by side 2.5 m before gate e mod G in race e."""
    lanes = 1.2 * (np.arange(env.num_drones) - (env.num_drones - 1) / 2)
    gates = np.arange(races) % len(track.gates)
    position = np.array([[before_gate(track, gate, 2.5, left) for left in lanes] for gate in gates])
    return state_of(env, position.transpose(2, 1, 0), next_gate=gates)


class Recorded(NamedTuple):
    """A rollout: state before each step, the action, the state after, and what the step did; time leads."""

    before: RaceState
    action: jax.Array
    after: RaceState
    outcome: StepOutcome


def record(env: RaceEnv, state: RaceState, actions: np.ndarray, rules: Rules) -> Recorded:
    """Fly given actions [T, 3, N, *B]; leaves come back as NumPy arrays [T, ...]."""
    return jax.tree.map(np.asarray, _player(env.step.__wrapped__)(state, jnp.asarray(actions), rules))


@functools.cache
def _player(step: Callable) -> Callable[..., Recorded]:
    def advance(now: RaceState, action: jax.Array, rules: Rules) -> tuple[RaceState, Recorded]:
        then, outcome = step(now, action, rules)
        return then, Recorded(now, action, then, outcome)

    return jax.jit(lambda start, actions, rules: jax.lax.scan(lambda s, a: advance(s, a, rules), start, actions)[1])


def fly_to_gates(
    env: RaceEnv, state: RaceState, steps: int, speed: float | np.ndarray, rules: Rules, noise: float = 0.0
) -> Recorded:
    """A plain pilot: aims a little beyond the next gate and holds a speed [m/s]; noise makes it stray."""
    shape = (steps, *state.drones.position_w.shape)
    stray = jnp.asarray(noise * np.random.default_rng(0).normal(size=shape), jnp.float32)
    return jax.tree.map(np.asarray, _pilot(env.step.__wrapped__)(env.course, state, stray, jnp.asarray(speed), rules))


@functools.cache
def _pilot(step: Callable) -> Callable[..., Recorded]:
    def act(course: Course, now: RaceState, speed: jax.Array) -> jax.Array:
        aim = course.position_w[:, now.next_gate] - now.drones.position_w
        aim = aim.at[:2].add(0.5 * course.normal_w[:, now.next_gate])
        wanted = speed * aim / jnp.maximum(jnp.linalg.norm(aim, axis=0), 0.1)
        return 1.2 * (wanted - now.drones.velocity_w)

    def fly(course, start, stray, speed, rules):
        def advance(now: RaceState, off: jax.Array) -> tuple[RaceState, Recorded]:
            action = jnp.clip(act(course, now, speed) + off, -1, 1)
            then, outcome = step(now, action, rules)
            return then, Recorded(now, action, then, outcome)

        return jax.lax.scan(advance, start, stray)[1]

    return jax.jit(fly)
