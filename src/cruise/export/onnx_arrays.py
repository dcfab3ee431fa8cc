"""Operations that move, join, add up or look up numbers as nodes of an ONNX graph."""

from typing import Any

import numpy as np

from cruise.errors import CruiseError
from cruise.export.onnx_graph import Graph, Rule, Tensor, is_one, joint_shape, turned
from cruise.export.program import Atom, Equation


def _reverse(graph: Graph, equation: Equation) -> None:
    axes, name = equation.params["dimensions"], graph.whole(equation.inputs[0])
    last = graph.integers(*[-1] * len(axes))
    far = graph.integers(*[np.iinfo(np.int64).min] * len(axes))
    graph.keep(equation.outputs[0], graph.node("Slice", name, last, far, graph.integers(*axes), last))


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
    graph.keep(equation.outputs[0], turned(graph, tensor.name, order), [tensor.shape[axis] for axis in order])


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
        if not is_one(shape[axis]) and not (_is_zero(first) and step == 1 and str(last) == str(shape[axis])):
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
    joint = [next((s for s in sizes if not is_one(s)), 1) for sizes in zip(*(t.shape for t in tensors), strict=True)]
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
    joint = joint_shape([graph.tensor(atom) for atom in equation.inputs])
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
        matrices = [
            turned(graph, graph.whole(atom), (1, 0)) if atom.ndim == 2 and axis != last else graph.whole(atom)
            for atom, (axis,), last in zip(atoms, contracted, (1, 0), strict=True)
        ]
        graph.keep(equation.outputs[0], graph.node("MatMul", *matrices))
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
        source = turned(graph, graph.whole(table), [*batch, *axes, *rest])
        index = graph.node("Cast", graph.whole(where), to=graph.onnx.TensorProto.INT64)
        name, places = graph.node("GatherND", source, index, batch_dims=len(batch)), where.shape[:-1]
        lead, sizes = 0, table.shape
    else:
        rest, (lead,) = [axis for axis in range(table.ndim) if axis not in axes], axes
        indices, rows = _rows(graph, where), graph.tensor(table)
        places = indices.shape
        if is_one(rows.shape[lead]):
            rows = Tensor(graph.whole(table), table.shape)
        name = graph.node("Gather", rows.name, indices.name, axis=lead)
        sizes = rows.shape
    found, shape = iter(range(lead, lead + len(places))), [sizes[axis] for axis in rest]
    shape[lead:lead] = places
    kept = iter(i for i in range(len(shape)) if not lead <= i < lead + len(places))
    order = [next(found) if axis not in numbers.offset_dims else next(kept) for axis in range(var.ndim)]
    graph.keep(var, turned(graph, name, order), [shape[axis] for axis in order])


def _rows(graph: Graph, where: Atom) -> Tensor:
    """Indices without their last axis, which has length 1."""
    if isinstance(where, np.ndarray):
        return graph.tensor_of(where[..., 0])
    tensor = graph.tensor(where)
    return Tensor(graph.node("Squeeze", tensor.name, graph.integers(len(tensor.shape) - 1)), tensor.shape[:-1])


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
    "rev": _reverse,
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
