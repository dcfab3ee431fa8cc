"""A policy as one C99 header."""

import re
from importlib import resources
from string import Template

import numpy as np

from cruise import __version__
from cruise.config import Track
from cruise.dynamics import cascade
from cruise.env import observation as env
from cruise.export.recording import Recording
from cruise.pilots.network import Perceptron
from cruise.presets import VEHICLES
from cruise.storage.policy_file import Policy

SAMPLES = 8  # of recorded flight, for the self test
PER_LINE = 8

SEES = {
    "extended": "its own flight, three gates and the others, in the frame of the target gate",
    "paper": "the state vector of the CRUISE paper",
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


def prefix_of(policy: Policy) -> str:
    """What every name in the header begins with."""
    name = re.sub(r"\W+", "_", policy.meta.name.removesuffix("/policy"), flags=re.ASCII).strip("_").lower()
    return name if name and not name[0].isdigit() else f"policy_{name}".rstrip("_")


def c_header(policy: Policy, track: Track, recording: Recording) -> str:
    """The header's text. `recording` gives the samples of its self test."""
    meta, vehicle = policy.meta, VEHICLES[policy.meta.vehicle]
    prefix = prefix_of(policy)
    names = {"p": prefix, "P": prefix.upper()}
    scales = {name: literal(getattr(env, name)) for name in SCALES}
    scales |= {name: literal(getattr(cascade, name)) for name in ("RATE_SCALE", "AGILITY_SCALE")}
    gains = {name: literal(value) for name, value in vars(vehicle.controller).items()}
    rows = sample_rows(recording, meta.drones)
    return _template("policy.h.in").substitute(
        names,
        **gains,
        title=_comment(meta.name),
        version=__version__,
        track=_comment(meta.track),
        steps=f"{meta.steps:,}",
        seed=meta.seed,
        kind=SEES[meta.observation],
        drones=meta.drones,
        others=meta.drones - 1,
        gates=len(track.gates),
        observation=policy.params.actor.layers[0].in_features,
        control_dt=literal(vehicle.control_dt),
        agility=literal(meta.agility),
        gate_rows="\n".join(f"    {{{braces(gate.position_w)}, {literal(gate.yaw)}}}," for gate in track.gates),
        weights=_weights(policy.params.actor, prefix),
        network=_network(policy.params.actor, prefix),
        observe=_template(f"observe_{meta.observation}.h.in").substitute(names, **scales).rstrip(),
        decode=TO_WORLD if meta.observation == "extended" else "    (void)gates;",
        samples=len(rows),
        sample_rows="\n".join(rows),
    )


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
    own = ("position_w", "velocity_w", "euler", "angular_velocity_b")
    fields = [f".{name} = {braces(inputs[name][row])}" for name in own]
    fields.append(f".next_gate = {int(inputs['next_gate'][row])}")
    if drones > 1:
        others = zip(*(inputs[f"others_{name}"][row] for name in ("position_w", "velocity_w", "airborne")), strict=True)
        each = ", ".join(f"{{{braces(place)}, {braces(velocity)}, {int(here)}}}" for place, velocity, here in others)
        fields.append(f".others = {{{each}}}")
    fields.append(f".action = {braces(recording.outputs['action'][row])}")
    fields.append(f".previous_action = {braces(inputs['previous_action'][row])}")
    return "{" + ", ".join(fields) + "}"
