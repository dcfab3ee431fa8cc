"""Writes an ONNX graph as arithmetic: `Value`s are the results of nodes, operators on them add nodes."""

from typing import Any, Union

import numpy as np

from cruise.extras import import_extra

OPSET = 17  # of the standard operators; every runtime since 2022 has it
IR_VERSION = 8

Operand = Union["Value", float, int, np.ndarray]


class Value:
    """A tensor of the graph."""

    __array_ufunc__ = None  # NumPy leaves `array - value` to us

    def __init__(self, graph: "Graph", name: str, kind: type = np.float32) -> None:
        """`kind` is the type that constants beside it take."""
        self.graph, self.name, self.kind = graph, name, kind

    def __add__(self, other: Operand) -> "Value":
        return self.graph.node("Add", self, other)

    def __sub__(self, other: Operand) -> "Value":
        return self.graph.node("Sub", self, other)

    def __rsub__(self, other: Operand) -> "Value":
        return self.graph.node("Sub", other, self)

    def __mul__(self, other: Operand) -> "Value":
        return self.graph.node("Mul", self, other)

    def __truediv__(self, other: Operand) -> "Value":
        return self.graph.node("Div", self, other)

    def __matmul__(self, other: Operand) -> "Value":
        return self.graph.node("MatMul", self, other)

    def __rmul__(self, other: Operand) -> "Value":
        return self.graph.node("Mul", self, other)

    def __neg__(self) -> "Value":
        return self.graph.node("Neg", self)


class Graph:
    """Nodes and constants in the order in which they were made."""

    def __init__(self) -> None:
        """An empty graph."""
        self.onnx = import_extra("onnx", "onnx", "export to ONNX needs the onnx library")
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def node(self, operator: str, *inputs: Operand, kind: type | None = None, **attributes: Any) -> Value:
        """A node's only, or first, output."""
        return self.nodes_of(operator, *inputs, outputs=1, kind=kind, **attributes)[0]

    def nodes_of(
        self, operator: str, *inputs: Operand, outputs: int, kind: type | None = None, **attributes: Any
    ) -> list[Value]:
        """All outputs of a node. Its type is that of its first input, unless said otherwise."""
        kinds = [value.kind for value in inputs if isinstance(value, Value)]
        kind = kind or (kinds[0] if kinds else np.float32)
        names = [value.name if isinstance(value, Value) else self.constant(value, kinds[0]).name for value in inputs]
        made = [f"{operator.lower()}_{len(self.nodes)}_{i}" for i in range(outputs)]
        self.nodes.append(self.onnx.helper.make_node(operator, names, made, **attributes))
        return [Value(self, name, kind) for name in made]

    def constant(self, value: float | int | np.ndarray, kind: type = np.float32) -> Value:
        """A constant; plain numbers become `kind`."""
        array = value if isinstance(value, np.ndarray) else np.array(value, kind)
        name = f"constant_{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(array, name))
        return Value(self, name, array.dtype.type)

    def name(self, value: Value, name: str) -> Value:
        """The same tensor under a name of its own."""
        self.nodes.append(self.onnx.helper.make_node("Identity", [value.name], [name]))
        return Value(self, name, value.kind)

    # Shapes

    def stack(self, values: list[Value], axis: int = 1) -> Value:
        """Join along a new axis."""
        return self.join([self.expand(value, axis) for value in values], axis)

    def join(self, values: list[Value], axis: int = 1) -> Value:
        """Join along an axis."""
        return self.node("Concat", *values, axis=axis)

    def expand(self, value: Value, axis: int) -> Value:
        """A new axis of length 1."""
        return self.node("Unsqueeze", value, self._axes(axis))

    def squeeze(self, value: Value, axis: int) -> Value:
        """Without an axis of length 1."""
        return self.node("Squeeze", value, self._axes(axis))

    def shaped(self, value: Value, *shape: int) -> Value:
        """Reshaped; 0 keeps an axis, -1 takes what is left."""
        return self.node("Reshape", value, self.constant(np.array(shape, np.int64)))

    def part(self, value: Value, first: int, last: int, axis: int = -1) -> Value:
        """Entries `first` to `last`, exclusive."""
        ends = [self.constant(np.array([end], np.int64)) for end in (first, last, axis)]
        return self.node("Slice", value, *ends)

    # Arithmetic

    def clip(self, value: Value, low: float, high: float) -> Value:
        """Within bounds."""
        return self.node("Clip", value, low, high)

    def largest(self, value: Value, bound: float) -> Value:
        """The larger of the two."""
        return self.node("Max", value, bound)

    def dot(self, a: Value, b: Value) -> Value:
        """Scalar product over the last axis, which stays with length 1."""
        return self.node("ReduceSum", a * b, self._axes(-1), keepdims=1)

    def norm(self, a: Value) -> Value:
        """Length over the last axis, which stays with length 1."""
        return self.node("Sqrt", self.dot(a, a))

    def _axes(self, axis: int) -> Value:
        return self.constant(np.array([axis], np.int64))
