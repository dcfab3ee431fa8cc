"""Operations that move, join, add up or look up numbers on arrays of expressions."""

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cruise.errors import CruiseError
from cruise.export.c_arrays import Arrays, Product, Rule, element, is_one, known, mapped, objects
from cruise.export.c_expressions import BOOL, FLOAT, INDEX, INT, Node, leaf, node, number, placed
from cruise.export.program import Atom, Equation

WRITTEN_OUT = 64  # weights of the largest product without a loop


def _moved(change: Callable[[np.ndarray, Equation], np.ndarray]) -> Rule:
    """What holds for open axes as for others."""
    return lambda run, equation: change(run.array(equation.inputs[0]), equation)


def _broadcast(array: np.ndarray, equation: Equation) -> np.ndarray:
    kept = equation.params["broadcast_dimensions"]
    shape = [1] * len(equation.outputs[0].shape)
    for axis, size in zip(kept, array.shape, strict=True):
        shape[axis] = size
    return array.reshape(shape)


def _squeeze(array: np.ndarray, equation: Equation) -> np.ndarray:
    return array.squeeze(tuple(equation.params["dimensions"]))


def _transpose(array: np.ndarray, equation: Equation) -> np.ndarray:
    return array.transpose(equation.params["permutation"])


def _reshape(run: Arrays, equation: Equation) -> np.ndarray:
    (atom,), (var,) = equation.inputs, equation.outputs
    if run.is_open(atom) and math.prod(run.array(atom).shape) == 1:
        return run.array(atom).reshape((1,) * len(var.shape))
    return run.closed(atom).reshape(known(var.shape))


def _slice(run: Arrays, equation: Equation) -> np.ndarray:
    array, params = run.array(equation.inputs[0]), equation.params
    strides = params["strides"] or (1,) * array.ndim
    cuts = []
    for axis, cut in enumerate(zip(params["start_indices"], params["limit_indices"], strides, strict=True)):
        whole = equation.inputs[0].shape[axis]
        if array.shape[axis] != 1 or is_one(whole):
            cuts.append(slice(*cut))
            continue
        cuts.append(slice(None))
        first, _, step = cut
        if run.is_open(equation.inputs[0]) and (first, step) != (0, 1):
            at = node("add", INT, node("mul", INT, INDEX, number(step, INT)), number(first, INT))
            array = _placed(array, at)
        if is_one(equation.outputs[0].shape[axis]):
            array = _placed(array, number(0, INT))
    return array[tuple(cuts)]


def _placed(array: np.ndarray, at: Node) -> np.ndarray:
    memo: dict[Node, Node] = {}
    return mapped([array], lambda one: placed(one, at, memo))


def _concatenate(run: Arrays, equation: Equation) -> np.ndarray:
    axis = equation.params["dimension"]
    arrays = [_along(run, atom, axis) for atom in equation.inputs]
    return np.concatenate(_level(arrays, axis), axis)


def _stack(run: Arrays, equation: Equation) -> np.ndarray:
    arrays = [run.array(atom) for atom in equation.inputs]
    return np.stack(np.broadcast_arrays(*arrays), equation.params["axis"])


def _along(run: Arrays, atom: Atom, axis: int) -> np.ndarray:
    """Every place along an axis."""
    array = run.array(atom)
    if array.shape[axis] == 1 and not is_one(atom.shape[axis]):
        return run.closed(atom)
    return array


def _level(arrays: list[np.ndarray], axis: int) -> list[np.ndarray]:
    """Broadcast along every other axis."""
    shape = np.broadcast_shapes(*((*array.shape[:axis], 1, *array.shape[axis + 1 :]) for array in arrays))
    return [np.broadcast_to(a, (*shape[:axis], a.shape[axis], *shape[axis + 1 :])) for a in arrays]


def _reduce(operator: str) -> Rule:
    def rule(run: Arrays, equation: Equation) -> np.ndarray:
        (atom,), (var,), axes = equation.inputs, equation.outputs, equation.params["axes"]
        array = run.array(atom)
        if any(array.shape[axis] == 1 and not is_one(atom.shape[axis]) for axis in axes):
            array = run.closed(atom)
        rest = [axis for axis in range(array.ndim) if axis not in axes]
        rows = array.transpose(*axes, *rest).reshape(-1, *(array.shape[axis] for axis in rest))
        both = functools.partial(node, operator, var.dtype)
        return np.asarray(functools.reduce(lambda a, b: mapped([a, b], both), list(rows)), object)

    return rule


def _product(run: Arrays, equation: Equation) -> np.ndarray:
    (contracted, batch), (left, right) = equation.params["dimension_numbers"], equation.inputs
    if batch != ((), ()) or max(left.ndim, right.ndim) > 2:
        raise CruiseError("a product of more than two axes cannot be exported to C")
    for matrix, vector, axis in ((left, right, contracted[0][0]), (right, left, contracted[1][0])):
        if isinstance(matrix, np.ndarray) and matrix.ndim == 2 and vector.ndim == 1 and matrix.size > WRITTEN_OUT:
            return _by_function(run, matrix if axis == 1 else matrix.T, vector)
    a, b = np.moveaxis(run.closed(left), contracted[0][0], 0), np.moveaxis(run.closed(right), contracted[1][0], 0)
    columns = [np.asarray(column, object) for column in a]
    spread = [column.reshape((*column.shape, *(1,) * (b.ndim - 1))) for column in columns]
    return functools.reduce(
        _added, (mapped([x, y], functools.partial(node, "mul", FLOAT)) for x, y in zip(spread, b, strict=True))
    )


def _added(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return mapped([a, b], functools.partial(node, "add", FLOAT))


def _by_function(run: Arrays, matrix: np.ndarray, vector: Atom) -> np.ndarray:
    source = run.filled(known(vector.shape)[0], list(run.array(vector).flat))
    name = f"v{len(run.arrays)}"
    run.arrays[name] = Product(name, run.table(matrix), matrix.shape, run.arrays[source])
    if len(matrix) <= WRITTEN_OUT // 8:
        return objects([element(name, i, FLOAT) for i in range(len(matrix))], (len(matrix),))
    return objects([leaf(f"{name}[@]")], (1,))


def _gather(run: Arrays, equation: Equation) -> np.ndarray:
    """Whole rows along one axis, of the caller's table by its index, of others by a choice."""
    (table, where), (var,), params = equation.inputs, equation.outputs, equation.params
    numbers, source = params["dimension_numbers"], run.array(table)
    axes, places = numbers.start_index_map, run.closed(where)[..., 0]
    one = {*numbers.collapsed_slice_dims, *numbers.operand_batching_dims}
    sizes = enumerate(zip(table.shape, params["slice_sizes"], strict=True))
    if (
        len(axes) != 1
        or axes != numbers.collapsed_slice_dims
        or any(axis not in one and str(full) != str(taken) for axis, (full, taken) in sizes)
    ):
        raise CruiseError("a look-up along more than one axis cannot be exported to C")
    result = np.empty(known(var.shape), object)
    indexed = [axis for axis in range(len(var.shape)) if axis not in numbers.offset_dims]
    for place in np.ndindex(*result.shape):
        batch = tuple(place[axis] for axis in indexed)
        kept = iter(place[axis] for axis in numbers.offset_dims)
        fixed = dict(
            zip(numbers.operand_batching_dims, (batch[i] for i in numbers.start_indices_batching_dims), strict=True)
        )
        at = [
            fixed[axis] if axis in fixed else slice(None) if axis in axes else next(kept) for axis in range(source.ndim)
        ]
        result[place] = _looked_up(source[tuple(at)], places[batch], table.shape[axes[0]])
    return result


def _looked_up(row: np.ndarray, at: Node, full: Any) -> Node:
    if len(row) == 1 and not is_one(full):
        return placed(row[0], at, {})
    chosen: Node = row[-1]
    for place in reversed(range(len(row) - 1)):
        chosen = node("select", chosen.kind, node("eq", BOOL, at, number(place, INT)), chosen, row[place])
    return chosen


def _top(run: Arrays, equation: Equation) -> list[np.ndarray]:
    """The largest first, ties in their order."""
    values = np.moveaxis(run.closed(equation.inputs[0]), equation.params["axis"], -1)
    count = equation.params["k"]
    largest, places = (np.empty((*values.shape[:-1], count), object) for _ in range(2))
    for row in np.ndindex(*values.shape[:-1]):
        numbers = [number(i, INT) for i in range(values.shape[-1])]
        order = _places(list(values[row]))
        for slot in range(count):
            here = [node("eq", BOOL, place, number(slot, INT)) for place in order]
            largest[row][slot], places[row][slot] = (_chosen(here, given) for given in (list(values[row]), numbers))
    return [np.moveaxis(array, -1, equation.params["axis"]) for array in (largest, places)]


def _places(values: list[Node]) -> list[Node]:
    """How many come before each."""
    zero = number(0, INT)

    def before(i: int, j: int) -> Node:
        return node("cast", INT, node("ge" if j < i else "gt", BOOL, values[j], values[i]))

    others = ([before(i, j) for j in range(len(values)) if j != i] for i in range(len(values)))
    return [functools.reduce(functools.partial(node, "add", INT), each, zero) for each in others]


def _chosen(here: list[Node], values: list[Node]) -> Node:
    return functools.reduce(lambda rest, pair: node("select", rest.kind, pair[0], rest, pair[1]),
                            zip(here[1:], values[1:], strict=True), values[0])  # fmt: skip


def _same(array: np.ndarray, equation: Equation) -> np.ndarray:
    del equation
    return array


RULES: dict[str, Rule] = {
    "rev": lambda run, equation: np.flip(run.closed(equation.inputs[0]), equation.params["dimensions"]),
    "copy": _moved(_same),
    "stop_gradient": _moved(_same),
    "broadcast_in_dim": _moved(_broadcast),
    "squeeze": _moved(_squeeze),
    "transpose": _moved(_transpose),
    "reshape": _reshape,
    "slice": _slice,
    "concatenate": _concatenate,
    "stack": _stack,
    "gather": _gather,
    "dim_as_value": lambda run, equation: objects([leaf("num_gates", INT)], ()),
    "dot_general": _product,
    "top_k": _top,
    "reduce_sum": _reduce("add"),
    "reduce_max": _reduce("max"),
    "reduce_min": _reduce("min"),
    "reduce_or": _reduce("or"),
    "reduce_and": _reduce("and"),
}
