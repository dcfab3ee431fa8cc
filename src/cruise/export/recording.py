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
from cruise.export.ports import POLES, command, sees_poles, tracking
from cruise.pilots.neural import NeuralPilot
from cruise.racing.course import Course
from cruise.racing.field import all_opponents
from cruise.rollout import team_rules
from cruise.storage.onnx_file import PREVIOUS
from cruise.vehicles import find_vehicle

RACES, STEPS = 16, 250


class Recording(NamedTuple):
    """Rows of drones in the air: inputs and outputs by name, as in the contract."""

    inputs: dict[str, np.ndarray]
    outputs: dict[str, np.ndarray]
    observation: np.ndarray  # [M, O]
    network: np.ndarray  # [M, A] what the network says

    @property
    def said(self) -> dict[str, np.ndarray]:
        """Of the outputs the action, and all that the next step is to be told of."""
        told = [name.removeprefix(PREVIOUS) for name in self.previous]
        return {name: self.outputs[name] for name in dict.fromkeys(["action", *told])}

    @property
    def previous(self) -> dict[str, np.ndarray]:
        """Of the inputs those that were outputs one step before."""
        return {name: rows for name, rows in self.inputs.items() if name.startswith(PREVIOUS)}

    @property
    def commands(self) -> np.ndarray:
        """[M, C] what the actions command, in the order of its outputs."""
        return np.column_stack([rows for name, rows in self.outputs.items() if name not in self.said])


def record(env: RaceEnv, pilot: NeuralPilot, seed: int = 0) -> Recording:
    """Fly `RACES` races for `STEPS` control steps under the rules of a race, and keep every drone's every step.

    All is kept that a policy could ask for, whether it does or not.
    """
    seen, wanted, airborne = _compiled_fly(env, pilot, jax.random.key(seed))
    rows = np.asarray(airborne).reshape(-1)
    flat = {name: np.asarray(value).reshape(-1, *value.shape[3:])[rows] for name, value in (seen | wanted).items()}
    inputs = {name: flat[name] for name in seen}
    inputs |= {name: np.asarray(value) for name, value in _gates(env.course).items()}
    if env.course.solids and sees_poles(env, pilot.observation):
        inputs[POLES] = np.asarray(env.course.solids["pole"][:3].T)
    return Recording(
        inputs,
        {name: flat[name] for name in wanted if name not in ("observation", "network")},
        flat["observation"],
        flat["network"],
    )


def _gates(course: Course) -> dict[str, Array]:
    yaw = jnp.arctan2(course.normal_w[1], course.normal_w[0])
    placed = {"gate_position_w": course.position_w.T, "gate_yaw": yaw, "gate_size": 2 * course.half_size.T}
    if course.tilt is not None:
        cos_pitch, sin_pitch, cos_roll, sin_roll = course.tilt
        tilt = (jnp.arctan2(sin_roll, cos_roll), jnp.arctan2(sin_pitch, cos_pitch))
        placed["gate_tilt"] = jnp.stack(tilt, axis=1)
    return placed


def _fly(env: RaceEnv, pilot: NeuralPilot, key: Array) -> tuple[dict[str, Array], dict[str, Array], Array]:
    """[T, E, N, ...] of everything, and who was in the air."""
    everyone = tuple(range(env.num_drones))
    vehicle = find_vehicle(pilot.vehicle)
    rules = team_rules([pilot] * env.num_drones, vehicle.collision_distance, 0, (RACES,))

    def step(carry: tuple[RaceState, dict[str, Array]], nothing: None) -> tuple[tuple, tuple]:
        state, before = carry
        memory, action = pilot.act(env, everyone, before.get("memory", ()), state, key)
        said = {"action": action} | tracking(vehicle, state.drones, action, pilot.agility)
        said |= {"memory": memory} if pilot.params.has_memory else {}
        told = {f"{PREVIOUS}{name}": before[name] for name in said if name in before}
        observation = env.observe_as[pilot.observation](state)
        _, network = pilot.params.apply(before.get("memory", ()), observation)
        commanded = command(env, pilot.agility, told | {"velocity_w": state.drones.velocity_w}, action)
        wanted = said | commanded | {"observation": observation, "network": network}
        after, _ = env.step(state, action, rules)
        kept = (jax.tree.map(_users, told) | _seen(state), jax.tree.map(_users, wanted), state.airborne.T)
        return (after, {name: said[name] for name in before}), kept

    start = _some_absent(env.reset(key, (RACES,)))
    first = _hovering(vehicle, start)
    if pilot.params.has_memory:
        first["memory"] = pilot.init(env, everyone, start)
    return jax.lax.scan(step, (start, first), length=STEPS)[1]


def _hovering(vehicle: Vehicle, start: RaceState) -> dict[str, Array]:
    """What counts as the action before the first, or as what was made of it for the vehicle's own loop."""
    name, memory = "action" if vehicle.told_directly else "tracking", start.drones.memory
    if isinstance(memory, Memory):
        return {name: memory.commands[0]}
    return {name: jnp.zeros((vehicle.own.action.size, *start.next_gate.shape))}


def _some_absent(state: RaceState) -> RaceState:
    """In every fourth race the last drone never takes off: where nobody crashes, nobody would be missing otherwise."""
    if len(state.out) == 1:
        return state
    return state._replace(out=state.out.at[-1, 1::4].set(True))


# Compiled without LLVM's optimisations, in half the time: it runs once.
_compiled_fly = eqx.filter_jit(  # type: ignore[call-overload]
    _fly, compiler_options={"xla_backend_optimization_level": 0}
)


def _seen(state: RaceState) -> dict[str, Array]:
    body, drones = state.drones.body, state.airborne.shape[0]
    own = {name: _users(value) for name, value in body._asdict().items()}
    own["next_gate"] = state.next_gate.T.astype(jnp.int32)
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
