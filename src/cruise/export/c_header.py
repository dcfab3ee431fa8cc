"""A policy as one C99 header."""

import math
import re
from importlib import resources
from string import Template
from typing import Any

import numpy as np

from cruise import __version__
from cruise.config import Track
from cruise.dynamics import cascade
from cruise.env import observation as env
from cruise.env import observation_body as body
from cruise.export.ports import airframe_of
from cruise.export.recording import Recording
from cruise.pilots.network import Perceptron
from cruise.storage.onnx_file import first_action
from cruise.storage.policy_file import Policy
from cruise.vehicles import find_vehicle

OWN = ("position_w", "velocity_w", "euler", "attitude", "angular_velocity_b")  # of a state, where a vehicle has it
SAMPLES = 8  # of recorded flight, for the self test
PER_LINE = 8

SEES = {
    "extended": "its own flight, three gates and the others, in the frame of the target gate",
    "paper": "the state vector of the CRUISE paper",
    "body": "two gates, its own flight and the nearest others, in the frame of its body",
    "body-near": "two gates, its own flight and the nearest others, fading, in the frame of its body",
}
TO_WORLD = """\
    const float c = cosf(gates[state->next_gate].yaw), s = sinf(gates[state->next_gate].yaw);
    const float forward = spoken[0], left = spoken[1];
    spoken[0] = c * forward - s * left;
    spoken[1] = s * forward + c * left;"""
SCALES = (
    *("DISTANCE_MAX", "SPEED_MAX", "EPSILON", "GATE_RANGE", "OPPONENT_RANGE", "SPEED_RANGE", "HEIGHT_RANGE"),
    *("LOOK_AHEAD", "MIN_CLOSING_SPEED", "LIMIT", "ABSENT", "NOTICE"),
)
BODY_SCALES = (
    *("CORNER_RANGE", "SPEED_RANGE", "HEIGHT_RANGE", "OPPONENT_RANGE", "LIMIT"),
    *("NEAREST", "GATES_AHEAD"),
)


def prefix_of(policy: Policy) -> str:
    """What every name in the header begins with."""
    name = re.sub(r"\W+", "_", policy.meta.name.removesuffix("/policy"), flags=re.ASCII).strip("_").lower()
    return name if name and not name[0].isdigit() else f"policy_{name}".rstrip("_")


def c_header(policy: Policy, track: Track, recording: Recording) -> str:
    """The header's text. `recording` gives the samples of its self test."""
    kind = policy.meta.observation
    own = _by_acceleration if airframe_of(policy.meta) is None else _by_thrust_and_rates
    words = _common(policy, track, recording) | own(policy, track)
    parts = {
        "about": f"about_{words['flown']}",
        "observe": f"observe_{'body' if kind in body.NOTICE else kind}",
        "command": f"command_{words['flown']}",
    }
    filled = {name: _template(f"{part}.h.in").substitute(words).rstrip() for name, part in parts.items()}
    return _template("policy.h.in").substitute(words | filled)


def _common(policy: Policy, track: Track, recording: Recording) -> dict[str, Any]:
    """What every header says."""
    meta, prefix, network = policy.meta, prefix_of(policy), policy.params.actor
    rows = sample_rows(recording, meta.drones)
    return {
        "p": prefix,
        "P": prefix.upper(),
        "title": _comment(meta.name),
        "version": __version__,
        "track": _comment(meta.track),
        "steps": f"{meta.all_steps:,}",
        "seed": meta.seed,
        "kind": SEES[meta.observation],
        "drones": meta.drones,
        "others": meta.drones - 1,
        "gates": len(track.gates),
        "observation": network.layers[0].in_features,
        "action": network.layers[-1].out_features,
        "control_dt": literal(find_vehicle(meta.vehicle).control_dt),
        "agility": literal(meta.agility),
        "weights": _weights(network, prefix),
        "network": _network(network, prefix),
        "samples": len(rows),
        "sample_rows": "\n".join(rows),
    }


def _by_acceleration(policy: Policy, track: Track) -> dict[str, Any]:
    """What is the paper's vehicle's own."""
    meta = policy.meta
    gains = vars(find_vehicle(meta.vehicle).controller)
    scales = {name: getattr(env, name) for name in SCALES}
    scales |= {name: getattr(cascade, name) for name in ("RATE_SCALE", "AGILITY_SCALE")}
    return {name: literal(value) for name, value in (gains | scales).items()} | {
        "flown": "acceleration",
        "frame": "world",
        "order": "own number + 1 first and around",
        "attitude": "    float euler[3];              /* roll, pitch, yaw [rad] */",
        "gate_size": "",
        "gate_rows": "\n".join(f"    {{{braces(gate.position_w)}, {literal(gate.yaw)}}}," for gate in track.gates),
        "decode": TO_WORLD if meta.observation == "extended" else "    (void)gates;",
    }


def _by_thrust_and_rates(policy: Policy, track: Track) -> dict[str, Any]:
    """What belongs to a vehicle that is flown by thrust and body rates."""
    meta = policy.meta
    vehicle, airframe = find_vehicle(meta.vehicle), airframe_of(meta)
    assert airframe is not None
    scales = {name: getattr(body, name) for name in BODY_SCALES}
    return {name: literal(value) if isinstance(value, float) else value for name, value in scales.items()} | {
        "flown": "ctbr",
        "frame": "collective thrust and body rates",
        "order": "in any order; airborne = 0 where there are fewer",
        "attitude": "    float attitude[4];           /* unit quaternion (w, x, y, z), body to world */",
        "gate_size": "    float size[2];       /* width and height of the opening [m] */\n",
        "gate_rows": "\n".join(
            f"    {{{braces(gate.position_w)}, {literal(gate.yaw)}, {braces((gate.width, gate.height))}}},"
            for gate in track.gates
        ),
        "decode": "    (void)gates;",
        "highest_rates": braces(airframe.rates.highest),
        "noticed": _noticed(prefix_of(policy), body.NOTICE[meta.observation]),
        "hovering": braces(first_action(meta)),
        "vehicle": vehicle.name,
        "mass": f"{vehicle.mass:g}",
        "thrust_to_weight": f"{meta.agility / vehicle.gravity:.3g}",
    }


def _noticed(prefix: str, notice: float) -> str:
    """How much is seen of who is so far away, as `cruise.env.observation_body.noticed`."""
    return "1.0f" if math.isinf(notice) else f"{prefix}_clip(2.0f - 2.0f * separation / {literal(notice)}, 0.0f, 1.0f)"


def _template(name: str) -> Template:
    return Template(resources.files("cruise.export").joinpath("c", name).read_text(encoding="utf-8"))


def _comment(text: str) -> str:
    """Text that cannot end a comment."""
    return "".join(c if c.isprintable() else " " for c in text).replace("*/", "* /").replace("/*", "/ *")


def literal(value: float) -> str:
    """A float of C that reads back as the same number."""
    return f"{np.format_float_scientific(np.float32(value), unique=True, trim='0', exp_digits=1)}f"


def braces(values: np.ndarray | tuple[float, ...]) -> str:
    """An initialiser."""
    return "{" + ", ".join(literal(value) for value in np.asarray(values).ravel().tolist()) + "}"


def _weights(network: Perceptron, prefix: str) -> str:
    parts = []
    for i, layer in enumerate(network.layers):
        for kind, array in (("weight", layer.weight), ("bias", layer.bias)):
            numbers = [literal(value) for value in np.asarray(array).ravel().tolist()]
            lines = (", ".join(numbers[k : k + PER_LINE]) for k in range(0, len(numbers), PER_LINE))
            body = ",\n    ".join(lines)
            parts.append(f"static const float {prefix}_{kind}_{i}[{len(numbers)}] = {{\n    {body}\n}};")
    return "\n".join(parts)


def _network(network: Perceptron, prefix: str) -> str:
    lines, source = [], "observation"
    last = len(network.layers) - 1
    for i, layer in enumerate(network.layers):
        rows, columns = layer.out_features, layer.in_features
        into = "action" if i == last else f"hidden_{i}"
        if i < last:
            lines.append(f"float hidden_{i}[{rows}];")
        arguments = f"{prefix}_weight_{i}, {prefix}_bias_{i}, {rows}, {columns}, {source}, {into}"
        lines.append(f"{prefix}_layer({arguments});")
        if i < last:
            lines.append(f"for (int i = 0; i < {rows}; ++i) hidden_{i}[i] = tanhf(hidden_{i}[i]);")
        source = into
    return "\n".join(f"    {line}" for line in lines)


def sample_rows(recording: Recording, drones: int) -> list[str]:
    """Some recorded states, with the actions that were flown, as initialisers of `state`."""
    count = len(recording.outputs["action"])
    chosen = np.unique(np.linspace(0, count - 1, min(SAMPLES, count)).astype(int)).tolist()
    return [f"        {state_initialiser(recording, row, drones)}," for row in chosen]


def state_initialiser(recording: Recording, row: int, drones: int) -> str:
    """One recorded state."""
    inputs = recording.inputs
    own = [name for name in OWN if name in inputs]
    fields = [f".{name} = {braces(inputs[name][row])}" for name in own]
    fields.append(f".next_gate = {int(inputs['next_gate'][row])}")
    if drones > 1:
        others = zip(*(inputs[f"others_{name}"][row] for name in ("position_w", "velocity_w", "airborne")), strict=True)
        each = ", ".join(f"{{{braces(place)}, {braces(velocity)}, {int(here)}}}" for place, velocity, here in others)
        fields.append(f".others = {{{each}}}")
    fields.append(f".action = {braces(recording.outputs['action'][row])}")
    fields.append(f".previous_action = {braces(inputs['previous_action'][row])}")
    return "{" + ", ".join(fields) + "}"
