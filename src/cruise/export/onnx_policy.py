"""A policy as an ONNX model: from the state in SI units to the action, or the bare network."""

from typing import Any

import numpy as np

from cruise import __version__
from cruise.export.onnx_graph import Graph
from cruise.export.onnx_printer import OPSET, write
from cruise.export.pilot_program import Model
from cruise.storage.config_file import to_json
from cruise.storage.onnx_file import METADATA, Contract, Port

IR_VERSION = 8


def onnx_model(model: Model, contract: Contract) -> bytes:
    """The model's file. Raises CruiseError where the onnx library is missing, or does not know an operation."""
    graph = write(model.program)
    helper = graph.onnx.helper
    made = helper.make_graph(
        graph.nodes,
        "cruise_policy",
        [_port(graph, port) for port in contract.inputs],
        [_port(graph, port) for port in contract.outputs],
        graph.constants,
        doc_string=f"CRUISE policy {contract.policy.name}; the entry {METADATA!r} of the metadata is its contract",
    )
    file = helper.make_model(made, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    file.producer_name, file.producer_version = "cruise", __version__
    helper.set_model_props(file, {METADATA: to_json(contract)})
    graph.onnx.checker.check_model(file, full_check=True)
    data: bytes = file.SerializeToString()
    return data


def _port(graph: Graph, port: Port) -> Any:
    kind = graph.onnx.helper.np_dtype_to_tensor_dtype(np.dtype(port.type))
    shape = [int(axis) if axis.isdigit() else axis for axis in port.shape]
    return graph.onnx.helper.make_tensor_value_info(port.name, kind, shape)
