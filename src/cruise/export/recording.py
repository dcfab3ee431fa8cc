"""Races recorded with everything that goes into a policy and everything that comes out, to compare an export with."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cruise.config import Vehicle
from cruise.dynamics.quadrotor import Memory
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.export.ports import POLES, command, sees_poles
from cruise.pilots.neural import NeuralPilot
from cruise.racing.course import Course
from cruise.racing.field import all_opponents
from cruise.rollout import team_rules
from cruise.vehicles import find_vehicle

RACES, STEPS = 16, 250


class Recording(NamedTuple):
    """Rows of drones in the air: inputs and outputs by name, as in the contract."""

    inputs: dict[str, np.ndarray]
    outputs: dict[str, np.ndarray]
    observation: np.ndarray  # [M, O]
    network: np.ndarray  # [M, A] what the network says


def record(env: RaceEnv, pilot: NeuralPilot, seed: int = 0) -> Recording:
    """Fly `RACES` races for `STEPS` control steps under the rules of a race, and keep every drone's every step."""
    seen, wanted, airborne = _compiled_fly(env, pilot, jax.random.key(seed))
    rows = np.asarray(airborne).reshape(-1)
    flat = {name: np.asarray(value).reshape(-1, *value.shape[3:])[rows] for name, value in (seen | wanted).items()}
    inputs = {name: flat[name] for name in seen if name in flat}
    inputs |= {name: np.asarray(value) for name, value in _gates(env.course, find_vehicle(pilot.vehicle)).items()}
    if env.course.solids and sees_poles(env, pilot.observation):
        inputs[POLES] = np.asarray(env.course.solids["pole"][:3].T)
    return Recording(
        inputs,
        {name: flat[name] for name in wanted if name not in ("observation", "network")},
        flat["observation"],
        flat["network"],
    )


def _gates(course: Course, vehicle: Vehicle) -> dict[str, Array]:
    yaw = jnp.arctan2(course.normal_w[1], course.normal_w[0])
    placed = {"gate_position_w": course.position_w.T, "gate_yaw": yaw}
    return placed | ({} if vehicle.flown_by == "cascade" else {"gate_size": 2 * course.half_size.T})


def _fly(env: RaceEnv, pilot: NeuralPilot, key: Array) -> tuple[dict[str, Array], dict[str, Array], Array]:
    """[T, E, N, ...] of everything, and who was in the air."""
    everyone = tuple(range(env.num_drones))
    vehicle = find_vehicle(pilot.vehicle)
    rules = team_rules([pilot] * env.num_drones, vehicle.collision_distance, 0, (RACES,))

    def step(carry: tuple[RaceState, Array], nothing: None) -> tuple[tuple[RaceState, Array], tuple]:
        state, previous = carry
        observation = env.observe_as[pilot.observation](state)
        _, action = pilot.act(env, everyone, (), state, key)
        wanted = {
            "observation": observation,
            "network": pilot.params.mean_action(observation),
            "action": action,
        } | command(env, pilot.agility, {"previous_action": previous, "velocity_w": state.drones.velocity_w}, action)
        after, _ = env.step(state, action, rules)
        kept = (_seen(state, previous), jax.tree.map(_users, wanted), state.airborne.T)
        return (after, action), kept

    start = _some_absent(env.reset(key, (RACES,)))
    return jax.lax.scan(step, (start, _first_action(env, start)), length=STEPS)[1]


def _first_action(env: RaceEnv, start: RaceState) -> Array:
    """What counts as the action before the first: the one that hovers, or none at all."""
    memory = start.drones.memory
    if isinstance(memory, Memory):
        return memory.commands[0]
    return jnp.zeros((env.dynamics.action_size, env.num_drones, RACES))


def _some_absent(state: RaceState) -> RaceState:
    """In every fourth race the last drone never takes off: where nobody crashes, nobody would be missing otherwise."""
    if len(state.out) == 1:
        return state
    return state._replace(out=state.out.at[-1, 1::4].set(True))


# Compiled without LLVM's optimisations, in half the time: it runs once.
_compiled_fly = eqx.filter_jit(  # type: ignore[call-overload]
    _fly, compiler_options={"xla_backend_optimization_level": 0}
)


def _seen(state: RaceState, previous: Array) -> dict[str, Array]:
    body, drones = state.drones.body, state.airborne.shape[0]
    own = {name: _users(value) for name, value in body._asdict().items()}
    own |= {"previous_action": _users(previous), "next_gate": state.next_gate.T.astype(jnp.int32)}
    if drones == 1:
        return own

    def others(values: Array) -> Array:
        """[C, N, E] of every drone's opponents, own number + 1 first and around: [E, N, N - 1, C]."""
        return all_opponents(values, 1).transpose(3, 2, 1, 0)

    return own | {
        "others_position_w": others(body.position_w),
        "others_velocity_w": others(body.velocity_w),
        "others_airborne": others(state.airborne[None])[..., 0],
    }


def _users(values: Array) -> Array:
    """[C, N, E] -> [E, N, C], and [N, E] -> [E, N]."""
    return values.T
