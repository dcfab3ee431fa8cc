"""An ONNX graph while it is made: nodes, constants and what stands for the variables of a program.

What a broadcast of JAX writes out stays an axis of length 1 where ONNX broadcasts by itself. So a tensor may be smaller
than its variable in JAX; `Graph.whole` gives it the full shape where an operator needs that.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from cruise.export.program import Atom, Equation, Var
from cruise.extras import import_extra

UNDOES = {"Squeeze": "Unsqueeze", "Unsqueeze": "Squeeze"}


class Tensor(NamedTuple):
    """A tensor of the graph. Its shape is that of the variable, or 1, or a size that is known when it runs."""

    name: str
    shape: tuple[Any, ...]


class Graph:
    """Nodes and constants in the order in which they were made."""

    def __init__(self) -> None:
        """An empty graph."""
        self.onnx = import_extra("onnx", "onnx", "export to ONNX needs the onnx library")
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.made: dict[Any, str] = {}  # by what it was made of: nothing is made twice
        self.values: dict[str, tuple[int, ...]] = {}  # of constant sizes and axes
        self.sources: dict[str, tuple[str, tuple[str, ...], dict[str, Any]]] = {}
        self.tensors: dict[Var, Tensor] = {}
        self.axes: dict[str, tuple[str, int]] = {}  # a tensor that has a size not known before, and where

    def node(self, operator: str, *inputs: str, **attributes: Any) -> str:
        """The name of a node's output."""
        before = self.sources.get(inputs[0]) if inputs else None
        if before and before[0] == UNDOES.get(operator) and before[1][1:] == inputs[1:] and not attributes:
            return before[1][0]
        key = (operator, inputs, repr(sorted(attributes.items())))
        if key not in self.made:
            self.made[key] = name = f"{operator.lower()}_{len(self.nodes)}"
            self.nodes.append(self.onnx.helper.make_node(operator, inputs, [name], **attributes))
            self.sources[name] = operator, inputs, attributes
        return self.made[key]

    def constant(self, value: np.ndarray) -> str:
        """The name of a constant."""
        key = (value.dtype.str, value.shape, value.tobytes())
        if key not in self.made:
            self.made[key] = name = f"constant_{len(self.constants)}"
            self.constants.append(self.onnx.numpy_helper.from_array(value, name))
        return self.made[key]

    def integers(self, *values: int) -> str:
        """A constant vector of sizes or axes."""
        name = self.constant(np.array(values, np.int64))
        self.values[name] = tuple(map(int, values))
        return name

    def tensor(self, atom: Atom) -> Tensor:
        """What stands for a variable or constant."""
        if isinstance(atom, Var):
            return self.tensors[atom]
        small = np.asarray(atom[(slice(1),) * atom.ndim]) if atom.size and (atom == atom.flat[0]).all() else atom
        return Tensor(self.constant(small), small.shape)

    def keep(self, var: Var, name: str, shape: Sequence[Any] | None = None) -> None:
        """`name` is the tensor of a variable, of its full shape unless another is given."""
        shape = tuple(var.shape if shape is None else shape)
        self.tensors[var] = Tensor(name, shape)
        for axis, size in enumerate(shape):
            if not isinstance(size, int):
                self.axes.setdefault(str(size), (name, axis))

    def size(self, size: Any) -> str:
        """A size as a vector of one number."""
        if isinstance(size, int):
            return self.integers(size)
        name, axis = self.axes[str(size)]
        return self.node("Shape", name, start=axis, end=axis + 1)

    def sizes(self, shape: Sequence[Any]) -> str:
        """A shape as a vector; one size may be left to the runtime."""
        if all(isinstance(size, int) for size in shape):
            return self.integers(*shape)
        return self.node("Concat", *(self.size(size) for size in shape), axis=0)

    def whole(self, atom: Atom, keep: int | None = None) -> str:
        """The name of a tensor in its variable's shape; axis `keep` may stay as it is."""
        tensor = self.tensor(atom)
        wanted = [
            here if axis == keep else full
            for axis, (here, full) in enumerate(zip(tensor.shape, atom.shape, strict=True))
        ]
        if tuple(wanted) == tensor.shape:
            return tensor.name
        if isinstance(atom, np.ndarray):
            return self.constant(atom)
        return self.node("Expand", tensor.name, self.sizes(wanted))

    def tensor_of(self, value: np.ndarray) -> Tensor:
        """A constant as it is."""
        return Tensor(self.constant(np.ascontiguousarray(value)), value.shape)

    def drop_unused(self, wanted: set[str]) -> None:
        """Leave out what the outputs do not need."""
        kept = []
        for node in reversed(self.nodes):
            if wanted & set(node.output):
                kept.append(node)
                wanted |= set(node.input)
        self.nodes = kept[::-1]
        self.constants = [constant for constant in self.constants if constant.name in wanted]

    def reshaped(self, name: str, shape: Sequence[Any]) -> str:
        """Another shape; one size that is not known is left to the runtime."""
        unknown = [size for size in shape if not isinstance(size, int)]
        if len(unknown) <= 1:
            wanted = self.integers(*(size if isinstance(size, int) else -1 for size in shape))
        else:
            wanted = self.sizes(shape)
        return self.node("Reshape", name, wanted)


Rule = Callable[[Graph, Equation], None]


def joint_shape(tensors: Sequence[Tensor]) -> list[Any]:
    """What tensors broadcast to."""
    shapes = [tensor.shape for tensor in tensors if tensor.shape]
    return [next((size for size in sizes if not is_one(size)), 1) for sizes in zip(*shapes, strict=True)]


def is_one(size: Any) -> bool:
    """Whether a size is known and 1."""
    return isinstance(size, int) and size == 1


def turned(graph: Graph, name: str, order: Sequence[int]) -> str:
    """Transposed, together with what was before."""
    order, before = list(order), graph.sources.get(name)
    if before is not None and before[0] == "Transpose":
        name, order = before[1][0], [before[2]["perm"][axis] for axis in order]
    return name if order == sorted(order) else graph.node("Transpose", name, perm=order)
