"""What an exported graph is fed with, and what every observation of it needs."""

from dataclasses import dataclass

import numpy as np

from cruise.export.onnx_values import Graph, Value


@dataclass(frozen=True)
class StateInputs:
    """The inputs of `cruise.export.ports.state_ports`; None are those that a vehicle or a drone alone has not."""

    position: Value  # [B, 3]
    velocity: Value
    rates: Value
    previous_action: Value  # [B, A]
    next_gate: Value  # [B]
    gates: Value  # [G, 3]
    gate_yaw: Value  # [G]
    euler: Value | None = None  # [B, 3]
    attitude: Value | None = None  # [B, 4]
    gate_size: Value | None = None  # [G, 2]
    others_position: Value | None = None  # [B, M, 3]
    others_velocity: Value | None = None
    others_airborne: Value | None = None  # [B, M]


FEEDS = {
    "position": "position_w",
    "velocity": "velocity_w",
    "rates": "angular_velocity_b",
    "gates": "gate_position_w",
    "others_position": "others_position_w",
    "others_velocity": "others_velocity_w",
}  # fields that are called otherwise outside


def inputs_of(ports: dict[str, Value]) -> StateInputs:
    """The fields of what goes in, by the names of the ports."""
    names = {field: FEEDS.get(field, field) for field in StateInputs.__dataclass_fields__}
    return StateInputs(**{field: ports[name] for field, name in names.items() if name in ports})


def gate_ahead(g: Graph, state: StateInputs, ahead: int) -> Value:
    """[B] index of a gate after the next one."""
    count = g.node("Squeeze", g.node("Shape", state.gate_yaw, kind=np.int64))
    return g.node("Mod", state.next_gate + ahead, count)


def pick(g: Graph, table: Value, gate: Value) -> Value:
    """[B, C] of [G, C]: what belongs to each drone's gate."""
    return g.node("Gather", table, gate, kind=np.float32)


def heading_of(g: Graph, state: StateInputs, gate: Value) -> Value:
    """[B, 1] yaw of each drone's gate."""
    return g.expand(pick(g, state.gate_yaw, gate), 1)


def noticed(g: Graph, separation: Value, notice: float) -> Value:
    """How much of an opponent so far away is seen, as `cruise.env.observation_body.noticed`."""
    return g.clip(2.0 - 2.0 * separation / notice, 0.0, 1.0)


def nearest_first(g: Graph, ranked: Value, rows: Value, count: Value) -> Value:
    """The `count` rows [B, M, C] of the smallest `ranked` [B, M, 1], in their order."""
    _, order = g.nodes_of("TopK", ranked, count, outputs=2, axis=1, largest=0, sorted=1)
    shape = g.node("Shape", rows, kind=np.int64)
    wanted = g.join([g.part(shape, 0, 1, axis=0), count, g.part(shape, 2, 3, axis=0)], axis=0)
    order = g.node("Expand", Value(g, order.name, np.int64), wanted)
    return g.node("GatherElements", rows, order, axis=1)
