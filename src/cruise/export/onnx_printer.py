"""A program as the nodes of an ONNX graph."""

import numpy as np

from cruise.errors import CruiseError
from cruise.export import onnx_arrays, onnx_numbers
from cruise.export.onnx_graph import Graph
from cruise.export.program import Program

OPSET = 17  # of the standard operators; every runtime since 2022 has it
RULES = onnx_numbers.RULES | onnx_arrays.RULES


def write(program: Program) -> Graph:
    """The graph of a program whose inputs are named as the program's; outputs are named so too.

    Raises:
        CruiseError: the program has an operation that is not known here.
    """
    graph = Graph()
    for name, var in program.inputs.items():
        whole_number = var.dtype == np.int32  # a port has 64 bits
        graph.keep(var, graph.node("Cast", name, to=graph.onnx.TensorProto.INT32) if whole_number else name)
    for equation in program.equations:
        if equation.primitive not in RULES:
            raise CruiseError(f"an operation cannot be exported to ONNX: {equation.primitive}")
        RULES[equation.primitive](graph, equation)
    for name, atom in program.outputs.items():
        graph.nodes.append(graph.onnx.helper.make_node("Identity", [graph.whole(atom)], [name]))
    graph.drop_unused(set(program.outputs))
    return graph
