"""A policy as an ONNX model: from the state in SI units to the action, or the bare network."""

from typing import Any

import numpy as np

from cruise import __version__
from cruise.config import CascadeGains
from cruise.env.observation_body import NOTICE
from cruise.export import onnx_observation as build
from cruise.export.onnx_body import body, command
from cruise.export.onnx_state import StateInputs, inputs_of
from cruise.export.onnx_values import IR_VERSION, OPSET, Graph, Value
from cruise.export.ports import airframe_of
from cruise.pilots.network import Perceptron
from cruise.storage.config_file import to_json
from cruise.storage.onnx_file import METADATA, Contract, Port
from cruise.storage.policy_file import Policy
from cruise.vehicles import find_vehicle


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
    state, meta, airframe = inputs_of(ports), policy.meta, airframe_of(policy.meta)
    if airframe is not None:
        spoken = _network(g, body(g, state, airframe, NOTICE[meta.observation]), policy.params.actor)
        action = g.name(g.clip(spoken, -1.0, 1.0), "action")
        thrust, rates = command(g, action, airframe, meta.agility)
        g.name(thrust, "thrust")
        g.name(rates, "body_rates_b")
        return
    if meta.observation == "paper":
        spoken = _network(g, build.paper(g, state, num_gates), policy.params.actor)
    else:
        spoken = _network(g, build.extended(g, state, meta.agility), policy.params.actor)
        spoken = g.squeeze(g.expand(spoken, 1) @ _transposed(g, build.gate_rotation(g, state)), 1)
    action = g.name(g.clip(spoken, -1.0, 1.0), "action")
    vehicle = find_vehicle(meta.vehicle)
    wanted = _commanded(g, action, state, vehicle.controller, meta.agility * vehicle.control_dt)
    g.name(wanted, "acceleration_w")


def _transposed(g: Graph, matrices: Value) -> Value:
    return g.node("Transpose", matrices, perm=[0, 2, 1])


def _commanded(g: Graph, action: Value, state: StateInputs, gains: CascadeGains, error: float) -> Value:
    """`cruise.dynamics.cascade.commanded_acceleration`; `error` is that of velocity for an action of 1."""
    change = action - g.clip(state.previous_action, -1.0, 1.0)
    desired = action * (gains.velocity_p * error) + change * (gains.velocity_d * error)
    return desired * gains.position_p - state.velocity * gains.position_d
