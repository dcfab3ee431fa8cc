"""A policy as one C99 header."""

import re
from importlib import resources
from string import Template
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from cruise import __version__
from cruise.config import Track
from cruise.env.race_env import RaceEnv
from cruise.export.c_arrays import Arrays
from cruise.export.c_expressions import BOOL, FLOAT, INT, leaf, literal
from cruise.export.c_printer import statements
from cruise.export.c_program import run
from cruise.export.c_state import GATE, gate_rows, numbers_of, said_fields, sample_rows, start
from cruise.export.parts import Parts, make_parts
from cruise.export.pilot_program import make_model, ports_of, shapes_of_one
from cruise.export.ports import OWN, POLES, Sizes, commands_of, fed_back, said_ports
from cruise.export.recording import Recording
from cruise.export.trace import trace
from cruise.storage.onnx_file import PREVIOUS, Port
from cruise.storage.policy_file import Policy

PER_LINE = 8


def prefix_of(policy: Policy) -> str:
    """What every name in the header begins with."""
    name = re.sub(r"\W+", "_", policy.meta.name.removesuffix("/policy"), flags=re.ASCII).strip("_").lower()
    return name if name and not name[0].isdigit() else f"policy_{name}".rstrip("_")


def c_header(policy: Policy, track: Track, env: RaceEnv, recording: Recording) -> str:
    """The header's text. `recording` gives the samples of its self test.

    Raises:
        CruiseError: the policy has an operation that is not known here.
    """
    meta, prefix, commands = policy.meta, prefix_of(policy), commands_of(env.vehicle)
    ports = {port.name: port for port in make_model(policy, env, "state").inputs}
    own = [port for port in OWN if port.name in ports]
    said, previous = said_ports(policy, env), fed_back(said_ports(policy, env), env.vehicle)
    fields, rows = [name for name in GATE if f"gate_{name}" in ports], sample_rows(recording)
    arrays = Arrays(prefix)
    bodies = _bodies(policy, env, arrays, ports)
    words: dict[str, Any] = {
        "p": prefix,
        "P": prefix.upper(),
        "title": _comment(meta.name),
        "version": __version__,
        "track": _comment(meta.track),
        "steps": f"{meta.all_steps:,}",
        "seed": meta.seed,
        "kind": meta.observation,
        "vehicle": f"{env.vehicle.name}, {env.vehicle.mass:g} kg",
        "action_frame": f"in the {env.dynamics.action_frame}'s frame",
        "action_meaning": commands.meaning,
        "drones": meta.drones,
        "others": meta.drones - 1,
        "order": "in any order; airborne = 0 where there are fewer"
        if "any" in str(ports.get("others_position_w"))
        else "own number + 1 first and around",
        "gates": len(track.gates),
        "observation": policy.params.shape.observation_size,
        "action": env.dynamics.action_size,
        "control_dt": literal(env.dynamics.control_dt),
        "agility": literal(meta.agility),
        "own": "\n".join(f"    float {port.name}[{port.shape[1]}]; /* {_said(port)} */" for port in own),
        "gate_fields": "".join(
            f"    float {name}[2]; /* {GATE[name]} */\n" for name in GATE if f"gate_{name}" in ports
        ),
        "start": start(own, meta.drones - 1, said, previous),
        "gate_rows": "\n".join(gate_rows(track, fields)),
        "sizes": "\n".join(f"#define {prefix.upper()}_{port.name.upper()} {numbers_of(port)}" for port in said[1:]),
        "said": said_fields(prefix.upper(), said, previous),
        **_network_words(prefix, "memory" in [port.name for port in said]),
        "advance": "\n".join(_advance(prefix.upper(), port.name.removeprefix(PREVIOUS)) for port in previous),
        "compared": "\n".join(_compared(prefix, port.name) for port in said if port.name != "tracking"),
        "command_name": commands.function,
        "command_array": commands.array,
        "command_size": sum(numbers_of(port) for port in commands.ports),
        "command_said": commands.said,
        "tables": "\n".join(_table(name, values) for name, values in arrays.constants.items()),
        "samples": len(rows),
        "sample_rows": "\n".join(rows),
    }
    text = resources.files("cruise.export").joinpath("c", "policy.h.in").read_text(encoding="utf-8")
    return Template(text).substitute(words | {name: "\n".join(lines) for name, lines in bodies.items()})


def _said(port: Port) -> str:
    return f"{port.meaning} [{port.unit}]" if port.unit else port.meaning


def _bodies(policy: Policy, env: RaceEnv, arrays: Arrays, ports: dict[str, Port]) -> dict[str, list[str]]:
    """Lines of the header's functions, traced one by one for one drone."""
    parts, meta = make_parts(policy, env), policy.meta
    gates = ports["gate_yaw"].shape[0]
    given = ports_of(policy, env, Sizes(meta.drones - 1, int(gates) if gates.isdigit() else gates))
    state = shapes_of_one(tuple(port for port in given if port.name != POLES))  # a header has those of its track
    size, actions = policy.params.shape.observation_size, env.dynamics.action_size
    seen, said = (jax.ShapeDtypeStruct((number,), np.float32) for number in (size, actions))
    memory = {name: shape for name, shape in state.items() if name == "previous_memory"}
    functions = {
        "observe": (lambda values: {"observation": parts.observe(values)}, state),
        "network": (parts.network, {"observation": seen} | memory),
        "decode": (lambda values: _of_state(parts.decode(values, values["said"])), state | {"said": said}),
        "command": (lambda values: _commanded(parts, values, commands_of(env.vehicle).array), state | {"action": said}),
    }
    layout = env.layout(meta.observation)
    first, comments = 0, {}
    for entry in layout:
        comments[first] = _comment(f"{entry.name} [{entry.unit or 1}]")
        first += entry.size
    return {
        name: _body(arrays, function, shapes, comments if name == "observe" else {}, name)
        for name, (function, shapes) in functions.items()
    }


def _of_state(values: dict[str, Any]) -> dict[str, Any]:
    return {f"state->{name}": value for name, value in values.items()}


def _commanded(parts: Parts, values: dict[str, Any], name: str) -> dict[str, Any]:
    commanded = parts.command(values, values["action"])
    return {name: jnp.concatenate([jnp.atleast_1d(value) for value in commanded.values()])}


def _body(arrays: Arrays, function: Any, shapes: dict[str, Any], comments: dict[int, str], name: str) -> list[str]:
    program = trace(function, shapes)
    inputs = {key: _leaves(key, shape.shape) for key, shape in shapes.items()}
    if name == "command":
        inputs["action"] = _leaves("state->action", (shapes["action"].shape))
    if name == "network" and "previous_memory" in shapes:
        inputs["previous_memory"] = _nodes(["previous_memory[@]"], FLOAT)
    lines = statements(arrays, run(arrays, program, inputs), comments)
    text = "\n".join(lines)
    unused = [f"(void){word};" for word in ("gates", "num_gates") if name == "observe" and word not in text]
    return [f"    {line}" for line in [*unused, *lines]]


def _leaves(name: str, shape: tuple[Any, ...]) -> np.ndarray:
    """What C calls the numbers of an input."""
    if name.startswith("gate_"):
        field = name.removeprefix("gate_")
        names = [f"gates[@].{field}[{i}]" for i in range(shape[0])] if len(shape) > 1 else [f"gates[@].{field}"]
        return _nodes(names, FLOAT).reshape((*shape[:-1], 1))
    if name.startswith("others_"):
        field = name.removeprefix("others_")
        if field == "airborne":
            return _nodes([f"state->others[{k}].airborne" for k in range(shape[0])], BOOL)
        names = [f"state->others[{k}].{field}[{i}]" for i in range(shape[0]) for k in range(shape[1])]
        return _nodes(names, FLOAT).reshape(shape)
    if name == "next_gate":
        return _nodes(["state->next_gate"], INT).reshape(())
    place = name if name in ("said", "observation") or "->" in name else f"state->{name}"
    return _nodes([f"{place}[{i}]" for i in range(shape[0])], FLOAT)


def _nodes(names: list[str], kind: np.dtype) -> np.ndarray:
    array = np.empty(len(names), object)
    array[:] = [leaf(name, kind) for name in names]
    return array


def _comment(text: str) -> str:
    """Text that cannot end a comment."""
    return "".join(c if c.isprintable() else " " for c in text).replace("*/", "* /").replace("/*", "/ *")


def _table(name: str, values: np.ndarray) -> str:
    numbers = [literal(value) for value in values.ravel().tolist()]
    lines = (", ".join(numbers[k : k + PER_LINE]) for k in range(0, len(numbers), PER_LINE))
    body = ",\n    ".join(lines)
    return f"static const float {name}[{len(numbers)}] = {{\n    {body}\n}};"


def _network_words(prefix: str, remembers: bool) -> dict[str, str]:
    """Arguments of the bare network, where it is declared and where it is called."""
    size = f"{prefix.upper()}_MEMORY"
    return {
        "network_in": f", const float previous_memory[{size}]" if remembers else "",
        "network_out": f", float memory[{size}]" if remembers else "",
        "network_given": ", state->previous_memory" if remembers else "",
        "network_filled": ", state->memory" if remembers else "",
    }


def _advance(prefix: str, name: str) -> str:
    each = f"state->{PREVIOUS}{name}[i] = state->{name}[i];"
    return f"    for (int i = 0; i < {prefix}_{name.upper()}; ++i) {each}"


def _compared(prefix: str, name: str) -> str:
    size = f"{prefix.upper()}_{name.upper()}"
    return f"        worst = {prefix}_apart(state.{name}, recorded[k].{name}, {size}, worst);"
