"""Behaviour cloning: a policy that flies as people did, by their race logs, for a training to start from."""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float
from scipy.spatial.transform import Rotation

from cruise import __version__
from cruise.config import Track, TrainConfig, Vehicle
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.types import RaceState
from cruise.errors import CruiseError
from cruise.pilots.human import HUMAN
from cruise.pilots.network import ActorCritic, NetworkShape
from cruise.racing.motion import motion_row
from cruise.storage.policy_file import PolicyMeta, save_policy
from cruise.storage.race_log import COLLISIONS, EVENT_KINDS, RaceLog, load_race_log
from cruise.vehicles import find_vehicle, name_of

CLONE = "cloned"
BEFORE_A_CRASH = 1.0  # nobody learns from what led there [s]
LEAST_SAMPLES = 100
HELD_OUT = 0.1  # share of the samples by which the clone is judged
BATCH, STEPS, LEARNING_RATE = 256, 4000, 1e-3
SAME_PLACE = 1e-3  # [m]


class Samples(NamedTuple):
    """What people saw, and what they did."""

    observation: Array | np.ndarray  # [O, S]
    action: Array | np.ndarray  # [A, S], in the policy's frame


class Clone(NamedTuple):
    """A policy and how well it does what people did."""

    model: ActorCritic
    samples: int
    error: float  # root mean square of its actions on samples that it did not see, of 1 at full deflection
    scatter: float  # the same of the best constant action


def load_demonstrations(folder: Path) -> list[RaceLog]:
    """The race logs of a folder. Raises CruiseError where there are none or one is not sound."""
    paths = sorted(folder.glob("*.npz"))
    if not paths:
        raise CruiseError(f"--demonstrations {folder}: no race logs (.npz) there; `cruise fly` writes them")
    return [load_race_log(path) for path in paths]


def write_clone(folder: Path, config: TrainConfig, track: Track, logs: Sequence[RaceLog]) -> tuple[Path, Clone]:
    """Clone, and write the policy into `folder`; its path, and what it is worth. Raises CruiseError as `clone`."""
    vehicle = find_vehicle(config.vehicle)
    made = clone(config, track, vehicle, logs)
    meta = PolicyMeta(
        name=f"{folder.absolute().name}/{CLONE}",
        track=track.name,
        drones=config.drones,
        vehicle=config.vehicle,
        observation=config.observation,
        agility=vehicle.agility,
        steps=0,
        seed=config.seed,
        version=__version__,
        config=config,
        flown_on=None if track.variants else track,
        layout=make_race_env(track, config.drones, vehicle).layout(config.observation),
    )
    return save_policy(folder / f"{CLONE}.safetensors", made.model, meta), made


def clone(config: TrainConfig, track: Track, vehicle: Vehicle, logs: Sequence[RaceLog]) -> Clone:
    """Fit the policy network of a run to what people did, by least squares.

    Raises:
        CruiseError: the logs are of another track or vehicle, people hardly flew in them, or the run's policy has a
            memory or a value network of its own view.
    """
    if config.ppo.network != "mlp" or config.critic_observation:
        raise CruiseError("--demonstrations clones policies without memory whose value network sees what they see")
    parts = [part for log in logs for part in _of_people(log, config, track, vehicle)]
    if sum(part.action.shape[1] for part in parts) < LEAST_SAMPLES:
        raise CruiseError(
            f"--demonstrations: fewer than {LEAST_SAMPLES} control steps flown by people; "
            f"their pilots' names begin with {HUMAN!r}"
        )
    return _fit(config, Samples(*(np.concatenate(column, axis=1) for column in zip(*parts, strict=True))))


def _of_people(log: RaceLog, config: TrainConfig, track: Track, vehicle: Vehicle) -> Iterator[Samples]:
    """The samples of each drone that a person flew."""
    people = [drone for drone, name in enumerate(log.pilots.tolist()) if name.split(" ")[0] == HUMAN]
    if not people:
        return
    gates = np.array([gate.position_w for gate in track.gates])
    theirs = ", ".join(dict.fromkeys(log.vehicles[people].tolist()))  # rivals may have flown something else
    if theirs != vehicle.name or log.action.shape[2] < vehicle.action.size:
        raise CruiseError(f"--demonstrations were flown in {theirs!r}, this run trains for {name_of(vehicle)!r}")
    motions = np.array([motion_row(gate.motion) for gate in track.gates])
    if not (_same(log.gate_position, gates) and _same(log.gate_motion, motions)):
        raise CruiseError(f"--demonstrations were flown on {log.track!r}, this run trains on {track.name!r}")
    env = make_race_env(track, log.num_drones, vehicle)
    log = replace(log, action=log.action[:, :, : vehicle.action.size])  # as wide as the widest in a mixed field
    look = jax.jit(lambda state: _seen(env, config.observation, state, log))
    observed, actions = (np.asarray(values) for values in look(state_of(env, log)))
    for drone in people:
        flown = log.airborne[:, drone] & (log.time < _crash(log, drone) - BEFORE_A_CRASH)
        yield Samples(observed[:, drone, flown], actions[:, drone, flown])


def _same(ours: np.ndarray, theirs: np.ndarray) -> bool:
    return ours.shape == theirs.shape and np.allclose(ours, theirs, atol=SAME_PLACE)


def _crash(log: RaceLog, drone: int) -> float:
    """When a drone crashed, infinite where it did not [s]."""
    kinds = [EVENT_KINDS.index(name) for name in COLLISIONS]
    times = log.event_time[(log.event_drone == drone) & np.isin(log.event_kind, kinds)]
    return float(times.min(initial=np.inf))


def state_of(env: RaceEnv, log: RaceLog) -> RaceState:
    """The states of a race, its samples as a batch; what logs do not have is found from what they have.

    Body rates are those between the attitudes of the samples around each, commands in the rotors' memory the actions
    before it.
    """
    position, velocity, euler, action = (
        np.moveaxis(a, 0, -1).swapaxes(0, 1).astype(np.float32)  # [., N, T]
        for a in (log.position_w, log.velocity_w, log.euler, log.action)
    )
    turns = Rotation.from_euler("ZYX", np.moveaxis(euler, 0, -1).reshape(-1, 3)[:, ::-1])
    attitude = np.moveaxis(turns.as_quat(scalar_first=True).reshape(*euler.shape[1:], 4), -1, 0)
    rates = _rates(turns, euler.shape[1:], log.control_dt)
    body = {"velocity_w": velocity, "euler": euler, "attitude": attitude, "angular_velocity_b": rates}

    told = {name: np.float32(value) for name, value in body.items()}
    as_one_program = jax.jit(functools.partial(_state, env))
    return as_one_program(position, told, action, np.int32(log.next_gate.T), ~log.airborne.T)


def _state(
    env: RaceEnv, position_w: Array, body: dict[str, Array], action: Array, next_gate: Array, gone: Array
) -> RaceState:
    drones = env.dynamics.init(position_w, body["euler"][2])
    moved = {name: value for name, value in body.items() if name in drones.body._fields}
    memory = drones.memory
    if hasattr(memory, "commands"):
        memory = memory._replace(commands=_commands(memory.commands, action))
    drones = drones._replace(body=drones.body._replace(**moved), memory=memory)
    steps, none, none_finished = jnp.arange(next_gate.shape[1]), jnp.zeros_like(next_gate), jnp.zeros_like(gone)
    return env.with_gates_at(RaceState(drones, next_gate, none, gone, none_finished, steps))


def _rates(turns: Rotation, shape: tuple[int, ...], dt: float) -> Float[np.ndarray, "3 N T"]:
    """Body rates by central differences [rad/s]; none at the standing start, one-sided at the end."""
    index = np.arange(np.prod(shape)).reshape(shape)
    before, after = (np.concatenate(parts, axis=1) for parts in (
        (index[:, :1], index[:, :-1]), (index[:, 1:], index[:, -1:])
    ))  # fmt: skip
    step = (turns[before.ravel()].inv() * turns[after.ravel()]).as_rotvec().reshape(*shape, 3)
    per_second = np.full((shape[1], 1), 1 / (2 * dt))
    per_second[0], per_second[-1] = 0.0, 1 / dt
    return np.moveaxis(step * per_second, -1, 0)


def _commands(usual: Array, action: Array) -> Array:
    """[H, 4, N, T] the actions before each sample, the newest first, after what a drone at rest remembers."""
    for back in range(min(len(usual), action.shape[-1] - 1)):
        usual = usual.at[back, :, :, back + 1 :].set(action[..., : -(back + 1)])
    return usual


def _seen(env: RaceEnv, kind: str, state: RaceState, log: RaceLog) -> tuple[Array, Array]:
    """Observations [O, N, T], and actions [A, N, T] in the frame in which a policy on them speaks.

    That frame is a turned one, or the vehicle's own: the inverse of a turn is its transpose.
    """
    size = env.dynamics.action_size
    shape = state.next_gate.shape
    axes = [jnp.zeros((size, *shape)).at[k].set(1.0) for k in range(size)]
    turned = jnp.stack([env.decode_as[kind](state, axis) for axis in axes])  # [policy's axis, vehicle's axis, N, T]
    action = jnp.asarray(np.moveaxis(log.action, 0, -1).swapaxes(0, 1), jnp.float32)
    return env.observe_as[kind](state), jnp.einsum("ijnt,jnt->int", turned, action)


def _fit(config: TrainConfig, samples: Samples) -> Clone:
    key, order_key = jax.random.split(jax.random.key(config.seed))
    sizes = (samples.observation.shape[0], samples.action.shape[0])
    model = ActorCritic(NetworkShape(*sizes, config.ppo.hidden), config.ppo.initial_log_std, key)
    count = samples.observation.shape[1]
    order = np.asarray(jax.random.permutation(order_key, count))
    held, kept = np.split(order, [max(1, round(HELD_OUT * count))])
    told, judged = (Samples(*(jnp.asarray(a[:, part], jnp.float32) for a in samples)) for part in (kept, held))
    actor = _train(model.actor, told, order_key)
    error = float(jnp.sqrt(_loss(actor, judged.observation, judged.action)))
    scatter = float(jnp.sqrt(jnp.mean((judged.action - told.action.mean(axis=1, keepdims=True)) ** 2)))
    return Clone(eqx.tree_at(lambda m: m.actor, model, actor), count, error, scatter)


def _loss(actor: Any, observation: Any, action: Any) -> Array:
    return jnp.mean((jnp.clip(actor(observation), -1.5, 1.5) - action) ** 2)


@eqx.filter_jit
def _train(actor: Any, samples: Samples, key: Array) -> Any:
    """Adam on minibatches, its learning rate falling to zero along a cosine."""
    optimiser = optax.adam(optax.cosine_decay_schedule(LEARNING_RATE, STEPS))
    params, static = eqx.partition(actor, eqx.is_array)

    def step(carry: Any, number: Array) -> tuple[Any, None]:
        params, memory = carry
        rows = jax.random.randint(jax.random.fold_in(key, number), (BATCH,), 0, samples.action.shape[1])
        batch = (samples.observation[:, rows], samples.action[:, rows])
        gradient = jax.grad(lambda p: _loss(eqx.combine(p, static), *batch))(params)
        updates, memory = optimiser.update(gradient, memory)
        return (optax.apply_updates(params, updates), memory), None

    (params, _), _ = jax.lax.scan(step, (params, optimiser.init(params)), jnp.arange(STEPS))
    return eqx.combine(params, static)
