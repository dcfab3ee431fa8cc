"""The programs of an exported pilot: whole, for many drones at once, and part by part, for one."""

import functools
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import export
from jaxtyping import Array

from cruise.env.race_env import RaceEnv
from cruise.export.parts import LEAST_OTHERS, Parts, Values, make_parts, nearest_others
from cruise.export.ports import (
    WHERE_NEEDED,
    Sizes,
    fed_back,
    memory_ports,
    network_action,
    observation_port,
    output_ports,
    state_ports,
)
from cruise.export.program import Program
from cruise.export.trace import trace
from cruise.storage.onnx_file import Interface, Port
from cruise.storage.policy_file import Policy

ANY = dict(zip("BMG", export.symbolic_shape("B, M, G"), strict=True))


class Model(NamedTuple):
    """A program with what is known of its inputs and outputs, in order."""

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    program: Program


def make_model(policy: Policy, env: RaceEnv, interface: Interface) -> Model:
    """The pilot for any number B of drones at once."""
    parts = make_parts(policy, env)
    if interface == "observation":
        memory = memory_ports(policy)
        inputs = (observation_port(policy.params.shape.observation_size), *fed_back(memory, env.vehicle))
        network = trace(lambda values: components_first(parts.network(components_first(values))), shapes(inputs))
        return Model(inputs, (network_action(policy.meta.observation, env), *memory), network)
    ports, program = max_freedom(policy, env, parts)
    return Model(ports, output_ports(policy, env), program)


def max_freedom(policy: Policy, env: RaceEnv, parts: Parts) -> tuple[tuple[Port, ...], Program]:
    """The whole pilot for as many gates as there are, or for as many as it was trained with where it needs to know."""
    nearest = max(policy.meta.drones - 1, LEAST_OTHERS)
    for sizes in _sizes(policy, env, parts):
        ports = ports_of(policy, env, sizes)
        try:
            program = trace(functools.partial(_whole, parts, nearest if sizes.others == "M" else None), shapes(ports))
        except Exception:  # JAX has no common one for a size that must be known
            if sizes.gates == "G":
                continue
            raise
        used = program.used
        return tuple(port for port in ports if port.name not in WHERE_NEEDED or port.name in used), program
    raise AssertionError


def ports_of(policy: Policy, env: RaceEnv, sizes: Sizes) -> tuple[Port, ...]:
    """What goes into the whole pilot."""
    start = jax.eval_shape(env.reset, jax.random.key(0))
    return state_ports(policy, env, start.drones.body._fields, sizes)


def shapes(ports: tuple[Port, ...]) -> dict[str, jax.ShapeDtypeStruct]:
    """Of the arrays that go into ports; JAX counts in 32 bits."""

    def size(axis: str) -> Any:
        return int(axis) if axis.isdigit() else ANY[axis]

    kinds = {port.name: np.int32 if port.type == "int64" else np.dtype(port.type) for port in ports}
    return {port.name: jax.ShapeDtypeStruct(tuple(map(size, port.shape)), kinds[port.name]) for port in ports}


def shapes_of_one(ports: tuple[Port, ...]) -> dict[str, jax.ShapeDtypeStruct]:
    """Of what one drone gives to the parts, components first."""

    def one(shape: jax.ShapeDtypeStruct, port: Port) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(shape.shape[port.shape[0] == "B" :][::-1], shape.dtype)

    return {port.name: one(shape, port) for port, shape in zip(ports, shapes(ports).values(), strict=True)}


def components_first(inputs: Values) -> Values:
    """[M, 3] -> [3, M], and back."""
    return {name: value.T for name, value in inputs.items()}


def _whole(parts: Parts, nearest: int | None, inputs: Values) -> Values:
    """[B, ...] of every drone; all of them see the same gates. Of any number of others the `nearest` count."""
    values = components_first(inputs if nearest is None else nearest_others(inputs, nearest))
    return components_first(parts.whole(values))


def _sizes(policy: Policy, env: RaceEnv, parts: Parts) -> Iterator[Sizes]:
    others: Any = policy.meta.drones - 1
    if others and _seen(policy, env, parts, others) == _seen(policy, env, parts, others + 1):
        others = "M"
    yield Sizes(others, "G")
    yield Sizes(others, env.course.num_gates)


def _seen(policy: Policy, env: RaceEnv, parts: Parts, others: int) -> int:
    """Size of the observation in a field of another size."""
    given = shapes_of_one(ports_of(policy, env, Sizes(others, env.course.num_gates)))
    seen: Array = jax.eval_shape(parts.observe, given)
    return seen.shape[0]
