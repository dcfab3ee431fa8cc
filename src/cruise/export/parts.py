"""An exported pilot as pure functions of SI quantities, made of the environment itself; components lead."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from cruise.env.race_env import RaceEnv
from cruise.env.surroundings import MovedGates, Surroundings
from cruise.env.types import RaceState
from cruise.export.ports import POLES, command, own_dynamics, tracking
from cruise.export.trace import own
from cruise.storage.policy_file import Policy

Values = dict[str, Array]  # by the names of ports, components first: position_w [3], others_position_w [3, M]
LEAST_OTHERS = 3  # that a policy for any number of others is given, however few it was trained with
OTHERS = ("others_position_w", "others_velocity_w", "others_airborne")


class Parts(NamedTuple):
    """What a pilot does from state to command, one after the other."""

    observe: Callable[[Values], Array]  # -> observation [O]
    network: Callable[[Values], Values]  # observation and previous_memory -> action in the frame of the first, memory
    decode: Callable[[Values, Array], Values]  # what the network says -> action [A] of the vehicle in [-1, 1], tracking
    command: Callable[[Values, Array], Values]  # -> what the action commands

    def whole(self, values: Values) -> Values:
        """All of it: the outputs of the pilot."""
        said = self.network(values | {"observation": self.observe(values)})
        said |= self.decode(values, said["action"])
        return said | self.command(values, said["action"])


def make_parts(policy: Policy, env: RaceEnv) -> Parts:
    """The functions of a policy."""
    kind, agility = policy.meta.observation, policy.meta.agility

    def network(values: Values) -> Values:
        memory, action = policy.params.apply(values.get("previous_memory", ()), values["observation"])
        return {"action": action} | ({"memory": memory} if policy.params.has_memory else {})

    def decode(values: Values, said: Array) -> Values:
        race = _race(env, agility, values)
        action = jnp.clip(own(env.decode_as[kind](race, said[:, None], (0,))), -1.0, 1.0)
        alone = jax.tree.map(lambda table: table[:, :1], race.drones._replace(memory=()))
        inner = tracking(env.vehicle, alone, action[:, None], agility)
        return {"action": action} | {name: own(value) for name, value in inner.items()}

    return Parts(
        observe=lambda values: own(env.observe_as[kind](_race(env, agility, values))),
        network=network,
        decode=decode,
        command=lambda values, action: command(env, agility, values, action),
    )


def nearest_others(inputs: Values, count: int) -> Values:
    """The nearest `count` of any number of others, padded with some that are not in the air where there are fewer.

    Components are last here: others_position_w [*B, M, 3].
    """
    here = inputs["others_airborne"]
    offset = jnp.where(here[..., None], inputs["others_position_w"] - inputs["position_w"][..., None, :], 0.0)
    separation = jnp.where(here, jnp.sqrt(jnp.sum(offset * offset, axis=-1)), jnp.inf)
    before = [(0, 0)] * (here.ndim - 1)
    _, order = jax.lax.top_k(-jnp.pad(separation, [*before, (0, count)], constant_values=jnp.inf), count)

    def chosen(rows: Array) -> Array:
        """[*B, M, ...] -> [*B, count, ...]."""
        padded = jnp.pad(rows, [*before, (0, count), *[(0, 0)] * (rows.ndim - here.ndim)])
        take = functools.partial(jnp.take, axis=0, mode="clip")
        for _ in before:
            take = jax.vmap(take)
        taken: Array = take(padded, order)
        return taken

    return inputs | {name: chosen(inputs[name]) for name in OTHERS}


def _race(env: RaceEnv, agility: float, values: Values) -> RaceState:
    """A race of the drone, which comes first, and its opponents. Of these position and velocity alone are known.

    The previous action is in the controller's memory as a step of the vehicle leaves it there.
    """
    position_w = _with_others(values, "position_w")
    batch = position_w.shape[1:]
    drones = env.dynamics.init(position_w, jnp.zeros(batch))
    body = {name: _for_all(values[name], batch) for name in drones.body._fields}
    body |= {"position_w": position_w, "velocity_w": _with_others(values, "velocity_w")}
    here = jnp.ones((1, *batch[1:]), bool)
    if "others_airborne" in values:
        here = jnp.concatenate([here, values["others_airborne"]])
    vehicle = env.vehicle
    dynamics, before = (
        (env.dynamics, "previous_action") if vehicle.told_directly else (own_dynamics(vehicle), "previous_tracking")
    )
    flown = dynamics.step(drones, _for_all(values[before], batch), agility)
    drones = drones._replace(body=type(drones.body)(**body), memory=flown.memory)
    none = jnp.zeros(batch, jnp.int32)
    return RaceState(
        drones=drones,
        next_gate=jnp.broadcast_to(values["next_gate"], batch),
        gates_passed=none,
        out=~here,
        finished=jnp.zeros(batch, bool),
        step=none[0],
        surroundings=Surroundings(_gates(env, values)),
    )


def _for_all(own: Array, batch: tuple[Any, ...]) -> Array:
    """What is known of the drone alone, as if it were so of all: nobody asks for the others'."""
    return jnp.broadcast_to(own[:, None], (*own.shape[:1], *batch))


def _with_others(values: Values, name: str) -> Array:
    """[C, 1 + M]. Who is not in the air may be anywhere, even at no number: it stands where the drone is."""
    own = values[name][:, None]
    if "others_airborne" not in values:
        return own
    return jnp.concatenate([own, jnp.where(values["others_airborne"], values[f"others_{name}"], own)], axis=1)


def _gates(env: RaceEnv, values: Values) -> MovedGates:
    yaw, solids = values["gate_yaw"], env.course.solids
    if solids is not None and POLES in values:
        solids = {**solids, "pole": jnp.concatenate([values[POLES], solids["pole"][3:]])}
    normal = jnp.stack([jnp.cos(yaw), jnp.sin(yaw)])
    tilt = None
    if "gate_tilt" in values:
        roll, pitch = values["gate_tilt"]
        tilt = jnp.stack([jnp.cos(pitch), jnp.sin(pitch), jnp.cos(roll), jnp.sin(roll)])
    return MovedGates(values["gate_position_w"], normal, values["gate_size"] / 2, tilt, solids)
