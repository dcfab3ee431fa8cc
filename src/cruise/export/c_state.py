"""What the structs of a header hold, gates and state, and their initialisers."""

from typing import Any

import numpy as np

from cruise.config import Track
from cruise.export.c_expressions import literal
from cruise.export.ports import OWN
from cruise.export.recording import Recording
from cruise.storage.onnx_file import PREVIOUS, Port

SAMPLES = 8  # of recorded flight, for the self test
GATE = {  # fields of a gate beside its place and heading, where they are needed
    "size": "width and height of the opening [m]",
    "tilt": "roll about the direction of flight and its pitch below the horizon [rad]",
}
SAID = {
    "action": "in [-1, 1]",
    "tracking": "what CRUISE's own loop makes of the action, for the next step",
    "memory": "what the network remembers",
}


def numbers_of(port: Port) -> int:
    """Numbers of one drone."""
    return int(np.prod([int(axis) for axis in port.shape[1:]]))


def gate_rows(track: Track, fields: list[str]) -> list[str]:
    """Initialisers of the gates, with these fields of `GATE`."""
    rows = []
    for gate in track.gates:
        more = {"size": gate.size, "tilt": (gate.roll, gate.pitch)}
        words = [braces(gate.position_w), literal(gate.yaw), *(braces(more[field]) for field in fields)]
        rows.append(f"    {{{', '.join(words)}}},")
    return rows


def said_fields(prefix: str, said: tuple[Port, ...], previous: tuple[Port, ...]) -> str:
    """Of the state: what the pilot says, and what of it is told at the next step."""
    lines = [f"    float {port.name}[{prefix}_{port.name.upper()}]; /* out: {SAID[port.name]} */" for port in said]
    names = [port.name.removeprefix(PREVIOUS) for port in previous]
    lines += [f"    float {PREVIOUS}{name}[{prefix}_{name.upper()}]; /* the one before */" for name in names]
    return "\n".join(lines)


def braces(values: Any) -> str:
    """An initialiser."""
    return "{" + ", ".join(literal(value) for value in np.asarray(values).ravel().tolist()) + "}"


def start(own: list[Port], others: int, said: tuple[Port, ...], previous: tuple[Port, ...]) -> str:
    """A state before the first action."""
    at_rest = {"attitude": (1.0, 0.0, 0.0, 0.0)}
    fields = [braces(at_rest.get(port.name, (0.0,) * numbers_of(port))) for port in own]
    nobody = f"{{{braces((0.0,) * 3)}, {braces((0.0,) * 3)}, 0}}"
    seen = [f"{{{', '.join([nobody] * others)}}}"] if others else []
    nothing = [braces((0.0,) * numbers_of(port)) for port in said]
    return "{" + ", ".join([*fields, "0", *seen, *nothing, *(braces(port.first) for port in previous)]) + "}"


def sample_rows(recording: Recording) -> list[str]:
    """Some recorded states, with the actions that were flown, as initialisers of `state`."""
    count = len(recording.outputs["action"])
    chosen = np.unique(np.linspace(0, count - 1, min(SAMPLES, count)).astype(int)).tolist()
    return [f"        {state_initialiser(recording, row)}," for row in chosen]


def state_initialiser(recording: Recording, row: int) -> str:
    """One recorded state."""
    inputs = recording.inputs
    fields = [braces(inputs[port.name][row]) for port in OWN if port.name in inputs]
    fields.append(str(int(inputs["next_gate"][row])))
    if "others_airborne" in inputs:
        others = zip(*(inputs[f"others_{name}"][row] for name in ("position_w", "velocity_w", "airborne")), strict=True)
        each = ", ".join(f"{{{braces(place)}, {braces(velocity)}, {int(here)}}}" for place, velocity, here in others)
        fields.append(f"{{{each}}}")
    fields += [braces(rows[row]) for rows in (*recording.said.values(), *recording.previous.values())]
    return "{" + ", ".join(fields) + "}"
