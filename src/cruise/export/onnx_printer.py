"""A program as the nodes of an ONNX graph.

What a broadcast of JAX writes out stays an axis of length 1 where ONNX broadcasts by itself. So a tensor may be smaller
than its variable in JAX; `Graph.whole` gives it the full shape where an operator needs that.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from cruise.errors import CruiseError
from cruise.export.program import Atom, Equation, Program, Var
from cruise.extras import import_extra

OPSET = 17  # of the standard operators; every runtime since 2022 has it


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


def _elementwise(operator: str, **attributes: Any) -> Rule:
    def rule(graph: Graph, equation: Equation) -> None:
        tensors = [graph.tensor(atom) for atom in equation.inputs]
        name = graph.node(operator, *(tensor.name for tensor in tensors), **attributes)
        graph.keep(equation.outputs[0], name, _joint(tensors))

    return rule


def _joint(tensors: Sequence[Tensor]) -> list[Any]:
    shapes = [tensor.shape for tensor in tensors if tensor.shape]
    return [next((size for size in sizes if not _is_one(size)), 1) for sizes in zip(*shapes, strict=True)]


def _is_one(size: Any) -> bool:
    return isinstance(size, int) and size == 1


def _logical(operator: str) -> Rule:
    """Of flags; JAX has the same name for whole numbers, bit by bit."""
    plain = _elementwise(operator)

    def rule(graph: Graph, equation: Equation) -> None:
        if equation.outputs[0].dtype != bool:
            raise CruiseError(f"an operation on the bits of whole numbers cannot be exported to ONNX: {operator}")
        plain(graph, equation)

    return rule


def _not_equal(graph: Graph, equation: Equation) -> None:
    tensors = [graph.tensor(atom) for atom in equation.inputs]
    name = graph.node("Not", graph.node("Equal", *(tensor.name for tensor in tensors)))
    graph.keep(equation.outputs[0], name, _joint(tensors))


def _remainder(graph: Graph, equation: Equation) -> None:
    _elementwise("Mod", fmod=1)(graph, equation)


def _select(graph: Graph, equation: Equation) -> None:
    which, no, yes = (graph.tensor(atom) for atom in equation.inputs)
    shape = _joint([which, no, yes])
    graph.keep(equation.outputs[0], graph.node("Where", which.name, yes.name, no.name), shape)


def _clamp(graph: Graph, equation: Equation) -> None:
    low, value, high = (graph.tensor(atom) for atom in equation.inputs)
    name = graph.node("Min", graph.node("Max", value.name, low.name), high.name)
    graph.keep(equation.outputs[0], name, _joint([low, value, high]))


def _integer_power(graph: Graph, equation: Equation) -> None:
    tensor = graph.tensor(equation.inputs[0])
    power = graph.constant(np.array(equation.params["y"], equation.outputs[0].dtype))
    graph.keep(equation.outputs[0], graph.node("Pow", tensor.name, power), tensor.shape)


def _reciprocal_root(graph: Graph, equation: Equation) -> None:
    tensor = graph.tensor(equation.inputs[0])
    graph.keep(equation.outputs[0], graph.node("Reciprocal", graph.node("Sqrt", tensor.name)), tensor.shape)


def _square(graph: Graph, equation: Equation) -> None:
    tensor = graph.tensor(equation.inputs[0])
    graph.keep(equation.outputs[0], graph.node("Mul", tensor.name, tensor.name), tensor.shape)


def _arctangent(graph: Graph, equation: Equation) -> None:
    """Of two numbers, from the arctangent of their quotient."""
    y, x = (graph.tensor(atom).name for atom in equation.inputs)
    zero, half, whole = (graph.constant(np.array(value, np.float32)) for value in (0.0, np.pi / 2, np.pi))
    below = graph.node("Less", y, zero)
    straight = graph.node("Atan", graph.node("Div", y, x))
    behind = graph.node("Where", below, graph.node("Sub", straight, whole), graph.node("Add", straight, whole))
    aside = graph.node("Mul", graph.node("Sign", y), half)
    name = graph.node("Where", graph.node("Less", x, zero), behind, aside)
    name = graph.node("Where", graph.node("Greater", x, zero), straight, name)
    graph.keep(equation.outputs[0], name, _joint([graph.tensor(atom) for atom in equation.inputs]))


def _reverse(graph: Graph, equation: Equation) -> None:
    axes, name = equation.params["dimensions"], graph.whole(equation.inputs[0])
    last = graph.integers(*[-1] * len(axes))
    far = graph.integers(*[np.iinfo(np.int64).min] * len(axes))
    graph.keep(equation.outputs[0], graph.node("Slice", name, last, far, graph.integers(*axes), last))


def _cast(graph: Graph, equation: Equation) -> None:
    (atom,), (var,) = equation.inputs, equation.outputs
    tensor = graph.tensor(atom)
    kind = graph.onnx.helper.np_dtype_to_tensor_dtype(var.dtype)
    same = atom.dtype == var.dtype
    graph.keep(var, tensor.name if same else graph.node("Cast", tensor.name, to=kind), tensor.shape)


def _same(graph: Graph, equation: Equation) -> None:
    graph.keep(equation.outputs[0], *graph.tensor(equation.inputs[0]))


def _broadcast(graph: Graph, equation: Equation) -> None:
    """New axes of length 1; ONNX broadcasts the rest."""
    (atom,), (var,), kept = equation.inputs, equation.outputs, equation.params["broadcast_dimensions"]
    tensor = graph.tensor(atom)
    shape = [tensor.shape[kept.index(axis)] if axis in kept else 1 for axis in range(len(var.shape))]
    new = [axis for axis in range(len(var.shape)) if axis not in kept]
    if isinstance(atom, np.ndarray):
        value = atom[tuple(slice(size) for size in tensor.shape)]
        graph.keep(var, *graph.tensor_of(value.reshape(shape)))
        return
    name = graph.node("Unsqueeze", tensor.name, graph.integers(*new)) if new else tensor.name
    graph.keep(var, name, shape)


def _pad(graph: Graph, equation: Equation) -> None:
    """At the ends of axes with one number."""
    (atom, value), config = equation.inputs, equation.params["padding_config"]
    pads = graph.integers(*(int(low) for low, _, _ in config), *(int(high) for _, high, _ in config))
    graph.keep(equation.outputs[0], graph.node("Pad", graph.whole(atom), pads, graph.whole(value)))


def _transpose(graph: Graph, equation: Equation) -> None:
    order, tensor = equation.params["permutation"], graph.tensor(equation.inputs[0])
    graph.keep(equation.outputs[0], _turned(graph, tensor.name, order), [tensor.shape[axis] for axis in order])


def _reshape(graph: Graph, equation: Equation) -> None:
    (var,) = equation.outputs
    graph.keep(var, graph.reshaped(graph.whole(equation.inputs[0]), var.shape))


def _squeeze(graph: Graph, equation: Equation) -> None:
    tensor, gone = graph.tensor(equation.inputs[0]), equation.params["dimensions"]
    shape = [size for axis, size in enumerate(tensor.shape) if axis not in gone]
    cut = graph.sources.get(tensor.name)
    if len(gone) == 1 and cut and cut[0] == "Slice" and graph.values.get(cut[1][3]) == (gone[0],):
        place = graph.constant(np.array(graph.values[cut[1][1]][0], np.int64))
        name = graph.node("Gather", cut[1][0], place, axis=int(gone[0]))
    else:
        name = graph.node("Squeeze", tensor.name, graph.integers(*gone)) if gone else tensor.name
    graph.keep(equation.outputs[0], name, shape)


def _slice(graph: Graph, equation: Equation) -> None:
    (atom,), (var,), params = equation.inputs, equation.outputs, equation.params
    strides = params["strides"] or (1,) * len(var.shape)
    tensor, cuts, shape = graph.tensor(atom), [], list(graph.tensor(atom).shape)
    for axis, (first, last, step) in enumerate(
        zip(params["start_indices"], params["limit_indices"], strides, strict=True)
    ):
        if not _is_one(shape[axis]) and not (_is_zero(first) and step == 1 and str(last) == str(shape[axis])):
            cuts.append((first, last, axis, step))
            shape[axis] = var.shape[axis]
    name = tensor.name
    if cuts:
        firsts, lasts, axes, steps = zip(*cuts, strict=True)
        name = graph.node("Slice", name, graph.integers(*firsts), graph.integers(*lasts), graph.integers(*axes),
                          graph.integers(*steps))  # fmt: skip
    graph.keep(var, name, shape)


def _is_zero(size: Any) -> bool:
    return isinstance(size, int) and size == 0


def _concatenate(graph: Graph, equation: Equation) -> None:
    axis, (var,) = equation.params["dimension"], equation.outputs
    tensors = [graph.tensor(atom) for atom in equation.inputs]
    joint = [next((s for s in sizes if not _is_one(s)), 1) for sizes in zip(*(t.shape for t in tensors), strict=True)]
    names = []
    for atom, tensor in zip(equation.inputs, tensors, strict=True):
        wanted = [atom.shape[axis] if i == axis else size for i, size in enumerate(joint)]
        name = tensor.name if tuple(wanted) == tensor.shape else graph.node("Expand", tensor.name, graph.sizes(wanted))
        names.append(name)
    joint[axis] = var.shape[axis]
    graph.keep(var, graph.node("Concat", *names, axis=axis), joint)


def _stack(graph: Graph, equation: Equation) -> None:
    """As a concatenation of what has a new axis of length 1."""
    axis, (var,) = equation.params["axis"], equation.outputs
    joint = _joint([graph.tensor(atom) for atom in equation.inputs])
    names = []
    for atom in equation.inputs:
        tensor = graph.tensor(atom)
        name = tensor.name if list(tensor.shape) == joint else graph.node("Expand", tensor.name, graph.sizes(joint))
        names.append(graph.node("Unsqueeze", name, graph.integers(axis)))
    shape = [*joint[:axis], len(names), *joint[axis:]]
    graph.keep(var, graph.node("Concat", *names, axis=axis), shape)


def _reduce(operator: str, in_input: bool = False) -> Rule:
    """Over axes, which newer operators take as an input."""

    def rule(graph: Graph, equation: Equation) -> None:
        (atom,), (var,), axes = equation.inputs, equation.outputs, list(map(int, equation.params["axes"]))
        name = graph.whole(atom)
        if atom.dtype == bool:
            name = graph.node("Cast", name, to=graph.onnx.TensorProto.INT32)
        if in_input:
            name = graph.node(operator, name, graph.integers(*axes), keepdims=0)
        else:
            name = graph.node(operator, name, axes=axes, keepdims=0)
        if atom.dtype == bool:
            name = graph.node("Cast", name, to=graph.onnx.TensorProto.BOOL)
        graph.keep(var, name)

    return rule


def _product(graph: Graph, equation: Equation) -> None:
    """A matrix by a vector as MatMul, which is fast; by letters what has more axes."""
    (contracted, batch), atoms = equation.params["dimension_numbers"], equation.inputs
    names = [graph.whole(atom) for atom in atoms]
    if batch == ((), ()) and max(atom.ndim for atom in atoms) <= 2 and len(contracted[0]) == 1:
        turned = [
            _turned(graph, graph.whole(atom), (1, 0)) if atom.ndim == 2 and axis != last else graph.whole(atom)
            for atom, (axis,), last in zip(atoms, contracted, (1, 0), strict=True)
        ]
        graph.keep(equation.outputs[0], graph.node("MatMul", *turned))
        return
    letters = iter("abcdefghijklmnopqrstuvwxyz")
    left, right = ([""] * atom.ndim for atom in atoms)
    for i, j in (*zip(*batch, strict=True), *zip(*contracted, strict=True)):
        left[i] = right[j] = next(letters)
    left, right = ([letter or next(letters) for letter in side] for side in (left, right))
    shared = [left[i] for i in batch[0]]
    free = [
        letter
        for side, gone, both in ((left, contracted[0], batch[0]), (right, contracted[1], batch[1]))
        for axis, letter in enumerate(side)
        if axis not in (*gone, *both)
    ]
    written = f"{''.join(left)},{''.join(right)}->{''.join(shared + free)}"
    graph.keep(equation.outputs[0], graph.node("Einsum", *names, equation=written))


def _gather(graph: Graph, equation: Equation) -> None:
    """Whole rows along one axis. The table is turned so that batches lead and the axis follows."""
    (table, where), (var,), params = equation.inputs, equation.outputs, equation.params
    numbers = params["dimension_numbers"]
    batch, axes = (tuple(map(int, dims)) for dims in (numbers.operand_batching_dims, numbers.start_index_map))
    leading = tuple(numbers.start_indices_batching_dims) == tuple(range(len(batch)))
    if len(axes) != 1 or axes != tuple(numbers.collapsed_slice_dims) or not leading or not _takes_all(table, params):
        raise CruiseError("a look-up along more than one axis cannot be exported to ONNX")
    if batch:
        rest = [axis for axis in range(table.ndim) if axis not in (*batch, *axes)]
        source = _turned(graph, graph.whole(table), [*batch, *axes, *rest])
        index = graph.node("Cast", graph.whole(where), to=graph.onnx.TensorProto.INT64)
        name, places = graph.node("GatherND", source, index, batch_dims=len(batch)), where.shape[:-1]
        lead, sizes = 0, table.shape
    else:
        rest, (lead,) = [axis for axis in range(table.ndim) if axis not in axes], axes
        indices, rows = _rows(graph, where), graph.tensor(table)
        places = indices.shape
        if _is_one(rows.shape[lead]):
            rows = Tensor(graph.whole(table), table.shape)
        name = graph.node("Gather", rows.name, indices.name, axis=lead)
        sizes = rows.shape
    found, shape = iter(range(lead, lead + len(places))), [sizes[axis] for axis in rest]
    shape[lead:lead] = places
    kept = iter(i for i in range(len(shape)) if not lead <= i < lead + len(places))
    order = [next(found) if axis not in numbers.offset_dims else next(kept) for axis in range(var.ndim)]
    graph.keep(var, _turned(graph, name, order), [shape[axis] for axis in order])


def _rows(graph: Graph, where: Atom) -> Tensor:
    """Indices without their last axis, which has length 1."""
    if isinstance(where, np.ndarray):
        return graph.tensor_of(where[..., 0])
    tensor = graph.tensor(where)
    return Tensor(graph.node("Squeeze", tensor.name, graph.integers(len(tensor.shape) - 1)), tensor.shape[:-1])


def _turned(graph: Graph, name: str, order: Sequence[int]) -> str:
    """Transposed, together with what was before."""
    order, before = list(order), graph.sources.get(name)
    if before is not None and before[0] == "Transpose":
        name, order = before[1][0], [before[2]["perm"][axis] for axis in order]
    return name if order == sorted(order) else graph.node("Transpose", name, perm=order)


def _takes_all(table: Atom, params: dict[str, Any]) -> bool:
    """Whether whole rows are taken."""
    one = {*params["dimension_numbers"].collapsed_slice_dims, *params["dimension_numbers"].operand_batching_dims}
    sizes = zip(table.shape, params["slice_sizes"], strict=True)
    return all(axis in one or str(full) == str(taken) for axis, (full, taken) in enumerate(sizes))


def _size(graph: Graph, equation: Equation) -> None:
    sizes = graph.node("Squeeze", graph.size(equation.params["dim"]), graph.integers(0))
    graph.keep(equation.outputs[0], graph.node("Cast", sizes, to=graph.onnx.TensorProto.INT32))


def _top(graph: Graph, equation: Equation) -> None:
    (atom,), (values, places), count = equation.inputs, equation.outputs, graph.integers(equation.params["k"])
    names = [f"top_{len(graph.nodes)}", f"places_{len(graph.nodes)}"]
    axis = int(equation.params["axis"])
    graph.nodes.append(graph.onnx.helper.make_node("TopK", [graph.whole(atom), count], names, axis=axis))
    graph.keep(values, names[0])
    graph.keep(places, graph.node("Cast", names[1], to=graph.onnx.TensorProto.INT32))


RULES: dict[str, Rule] = {
    **{name: _elementwise(name.capitalize()) for name in ("add", "sub", "mul", "div", "max", "min", "neg", "exp")},
    **{name: _elementwise(name.capitalize()) for name in ("abs", "log", "sin", "cos", "tan", "tanh", "sqrt", "floor")},
    **{name: _elementwise(name.capitalize()) for name in ("ceil", "sign", "pow", "erf", "asin", "acos", "atan")},
    **{name: _logical(name.capitalize()) for name in ("and", "or", "not", "xor")},
    "eq": _elementwise("Equal"),
    "lt": _elementwise("Less"),
    "gt": _elementwise("Greater"),
    "le": _elementwise("LessOrEqual"),
    "ge": _elementwise("GreaterOrEqual"),
    "ne": _not_equal,
    "atan2": _arctangent,
    "rev": _reverse,
    "logistic": _elementwise("Sigmoid"),
    "round": _elementwise("Round"),
    "rem": _remainder,
    "rsqrt": _reciprocal_root,
    "square": _square,
    "integer_pow": _integer_power,
    "clamp": _clamp,
    "select_n": _select,
    "convert_element_type": _cast,
    "copy": _same,
    "stop_gradient": _same,
    "broadcast_in_dim": _broadcast,
    "transpose": _transpose,
    "pad": _pad,
    "reshape": _reshape,
    "squeeze": _squeeze,
    "slice": _slice,
    "concatenate": _concatenate,
    "stack": _stack,
    "gather": _gather,
    "dim_as_value": _size,
    "dot_general": _product,
    "top_k": _top,
    "reduce_sum": _reduce("ReduceSum", in_input=True),
    "reduce_max": _reduce("ReduceMax"),
    "reduce_min": _reduce("ReduceMin"),
    "reduce_or": _reduce("ReduceMax"),
    "reduce_and": _reduce("ReduceMin"),
}
