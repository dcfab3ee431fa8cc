"""A policy as an ONNX model: from the state in SI units to the action in the world, or the bare network."""

from typing import Any

import numpy as np

from cruise import __version__
from cruise.config import CascadeGains
from cruise.export import onnx_observation as build
from cruise.export.onnx_values import IR_VERSION, OPSET, Graph, Value
from cruise.pilots.network import Perceptron
from cruise.presets import VEHICLES
from cruise.storage.config_file import to_json
from cruise.storage.onnx_file import METADATA, Contract, Port
from cruise.storage.policy_file import Policy

FEEDS = {
    "position": "position_w",
    "velocity": "velocity_w",
    "rates": "angular_velocity_b",
    "gates": "gate_position_w",
    "others_position": "others_position_w",
    "others_velocity": "others_velocity_w",
}  # fields of `StateInputs` that are called otherwise outside


def onnx_model(policy: Policy, contract: Contract) -> bytes:
    """The model's file. Raises CruiseError where the onnx library is missing."""
    g = Graph()
    ports = {port.name: Value(g, port.name, np.dtype(port.type).type) for port in contract.inputs}
    if contract.interface == "state":
        _whole(g, ports, policy, len(contract.gates))
    else:
        _network(g, ports["observation"], policy.params.actor, name="action")
    helper = g.onnx.helper
    graph = helper.make_graph(
        g.nodes,
        "cruise_policy",
        [_port(g, port) for port in contract.inputs],
        [_port(g, port) for port in contract.outputs],
        g.constants,
        doc_string=f"CRUISE policy {policy.meta.name}; the entry {METADATA!r} of the metadata is its contract",
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    model.producer_name, model.producer_version = "cruise", __version__
    helper.set_model_props(model, {METADATA: to_json(contract)})
    g.onnx.checker.check_model(model, full_check=True)
    data: bytes = model.SerializeToString()
    return data


def _port(g: Graph, port: Port) -> Any:
    kind = g.onnx.helper.np_dtype_to_tensor_dtype(np.dtype(port.type))
    shape = [int(axis) if axis.isdigit() else axis for axis in port.shape]
    return g.onnx.helper.make_tensor_value_info(port.name, kind, shape)


def _network(g: Graph, x: Value, network: Perceptron, name: str | None = None) -> Value:
    """Rows of `x` through the layers."""
    for i, layer in enumerate(network.layers):
        weight, bias = (np.asarray(array, np.float32) for array in (layer.weight, layer.bias))
        x = g.node("Gemm", x, weight, bias, transB=1)
        if i < len(network.layers) - 1:
            x = g.node("Tanh", x)
    return g.name(x, name) if name else x


def _whole(g: Graph, ports: dict[str, Value], policy: Policy, num_gates: int) -> None:
    meta = policy.meta
    names = {field: FEEDS.get(field, field) for field in build.StateInputs.__dataclass_fields__}
    state = build.StateInputs(**{field: ports[name] for field, name in names.items() if name in ports})
    if meta.observation == "paper":
        spoken = _network(g, build.paper(g, state, num_gates), policy.params.actor)
    else:
        spoken = _network(g, build.extended(g, state, meta.agility), policy.params.actor)
        spoken = g.squeeze(g.expand(spoken, 1) @ _transposed(g, build.gate_rotation(g, state)), 1)
    action = g.name(g.clip(spoken, -1.0, 1.0), "action")
    vehicle = VEHICLES[meta.vehicle]
    command = _commanded(g, action, state, vehicle.controller, meta.agility * vehicle.control_dt)
    g.name(command, "acceleration_w")


def _transposed(g: Graph, matrices: Value) -> Value:
    return g.node("Transpose", matrices, perm=[0, 2, 1])


def _commanded(g: Graph, action: Value, state: build.StateInputs, gains: CascadeGains, error: float) -> Value:
    """`cruise.dynamics.cascade.commanded_acceleration`; `error` is that of velocity for an action of 1."""
    change = action - g.clip(state.previous_action, -1.0, 1.0)
    desired = action * (gains.velocity_p * error) + change * (gains.velocity_d * error)
    return desired * gains.position_p - state.velocity * gains.position_d
