"""A program's arrays as NumPy arrays of scalar expressions: whatever moves numbers about costs nothing in C.

An axis may be open: it has length 1 and its expression holds the index, that of a gate in the caller's table or of a
loop. So tables of any length and the layers of a network stay loops, and all else is written out.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cruise.errors import CruiseError
from cruise.export.c_expressions import BOOL, FLOAT, FUNCTIONS, INDEX, INT, Node, leaf, node, number, placed
from cruise.export.program import Atom, Equation, Program, Var

WRITTEN_OUT = 64  # weights of the largest product without a loop


class Product:
    """A matrix of weights times a vector: the one thing that C does in a function of its own."""

    def __init__(self, name: str, weight: str, shape: tuple[int, int], vector: "Filled") -> None:
        """`weight` is the name of the matrix [rows, columns]."""
        self.name, self.weight, self.shape, self.vector = name, weight, shape, vector
        self.needs = (*vector.needs, vector)

    @property
    def nodes(self) -> Sequence[Node]:
        """Expressions that it reads."""
        return ()


class Filled:
    """An array of C that is filled from expressions: one for each place, or one for all that holds the index."""

    def __init__(self, name: str, size: int, nodes: Sequence[Node]) -> None:
        """`name` is that of a port, which is there already, where there are no nodes."""
        self.name, self.size, self.nodes = name, size, nodes
        self.needs: tuple[Any, ...] = ()


class Arrays:
    """Runs a program over expressions."""

    def __init__(self, prefix: str) -> None:
        """Names of constants begin with the prefix."""
        self.prefix = prefix
        self.constants: dict[str, np.ndarray] = {}
        self.arrays: dict[str, Any] = {}  # Product and Filled by name
        self.ports: dict[tuple[Node, ...], str] = {}
        self.values: dict[Var, np.ndarray] = {}

    def run(self, program: Program, inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Expressions of the outputs. Raises CruiseError where the program has an operation that is not known here."""
        self.values |= {var: inputs[name] for name, var in program.inputs.items() if name in inputs}
        for equation in program.equations:
            if equation.primitive not in RULES:
                raise CruiseError(f"an operation cannot be exported to C: {equation.primitive}")
            results = RULES[equation.primitive](self, equation)
            results = results if isinstance(results, list) else [results]
            self.values |= dict(zip(equation.outputs, results, strict=True))
        return {name: self.closed(atom) for name, atom in program.outputs.items()}

    def array(self, atom: Atom) -> np.ndarray:
        """Expressions of a variable or constant."""
        if isinstance(atom, Var):
            return self.values[atom]
        return _objects([number(value, atom.dtype) for value in atom.ravel()], atom.shape)

    def is_open(self, atom: Atom) -> bool:
        """Whether an axis of it holds the index."""
        return isinstance(atom, Var) and any(one.index for one in self.values[atom].flat)

    def closed(self, atom: Atom) -> np.ndarray:
        """Expressions of every place of it."""
        given = self.array(atom)
        if not self.is_open(atom):
            return np.broadcast_to(given, _known(atom.shape))
        (size,) = (full for full, here in zip(_known(atom.shape), given.shape, strict=True) if full != here)
        name = self.filled(size, list(given.flat))
        return _objects([_element(name, i, atom.dtype) for i in range(size)], _known(atom.shape))

    def filled(self, size: int, nodes: Sequence[Node]) -> str:
        """The name of an array with these numbers."""
        key = tuple(nodes)
        if key not in self.ports:
            self.ports[key] = name = f"v{len(self.arrays)}"
            self.arrays[name] = Filled(name, size, nodes)
        return self.ports[key]

    def table(self, values: np.ndarray) -> str:
        """The name of constant numbers."""
        data = np.asarray(values, np.float32)
        for name, known in self.constants.items():
            if known.shape == data.shape and (known == data).all():
                return name
        name = f"{self.prefix}_{'weight' if data.ndim == 2 else 'numbers'}_{len(self.constants)}"
        self.constants[name] = data
        return name

    def alike(self, atoms: Sequence[Atom], shape: tuple[Any, ...]) -> list[np.ndarray]:
        """Arrays that NumPy broadcasts: where one axis is open, constants are too; else none is."""
        arrays = [self.array(atom) for atom in atoms]
        opened = [array for atom, array in zip(atoms, arrays, strict=True) if self.is_open(atom)]
        if not opened:
            return arrays
        axis = next(i for i, size in enumerate(shape) if opened[0].shape[i] == 1 and not _is_one(size))
        if any(
            not self.is_open(a) and _long(b, axis) and isinstance(a, Var) for a, b in zip(atoms, arrays, strict=True)
        ):
            return [self.closed(atom) for atom in atoms]
        return [self._opened(a, b, axis) if _long(b, axis) else b for a, b in zip(atoms, arrays, strict=True)]

    def _opened(self, atom: Atom, array: np.ndarray, axis: int) -> np.ndarray:
        if isinstance(atom, Var):
            return array
        if atom.size != atom.shape[axis]:
            raise CruiseError("a table of constants of two axes cannot be exported to C")
        if (atom == atom.flat[0]).all():
            return array.ravel()[:1].reshape([1] * atom.ndim)
        return _objects([leaf(f"{self.table(atom.ravel())}[@]")], (1,) * atom.ndim)


def _long(array: np.ndarray, axis: int) -> bool:
    return array.ndim > axis and array.shape[axis] != 1


def _is_one(size: Any) -> bool:
    return isinstance(size, int) and size == 1


def _known(shape: Sequence[Any]) -> tuple[int, ...]:
    if not all(isinstance(size, int) for size in shape):
        raise CruiseError("the C header needs to know the number of gates")
    return tuple(shape)


def _objects(nodes: Sequence[Node], shape: Sequence[int]) -> np.ndarray:
    array = np.empty(len(nodes), object)
    array[:] = nodes
    return array.reshape(shape)


def _element(name: str, place: int, kind: np.dtype) -> Node:
    return leaf(f"{name}[{place}]", kind)


Rule = Callable[[Arrays, Equation], Any]


def _map(arrays: Sequence[Any], function: Callable[..., Node]) -> np.ndarray:
    result = np.frompyfunc(function, len(arrays), 1)(*arrays)
    return np.asarray(result, object)


def _elementwise(operator: str) -> Rule:
    def rule(run: Arrays, equation: Equation) -> np.ndarray:
        (var,) = equation.outputs
        return _map(run.alike(equation.inputs, var.shape), functools.partial(node, operator, var.dtype))

    return rule


def _composed(function: Callable[..., Node]) -> Rule:
    """From operators that C has."""

    def rule(run: Arrays, equation: Equation) -> np.ndarray:
        return _map(run.alike(equation.inputs, equation.outputs[0].shape), function)

    return rule


def _float(operator: str, *inputs: Node) -> Node:
    return node(operator, FLOAT, *inputs)


ONE, ZERO = number(1.0, FLOAT), number(0.0, FLOAT)


def _sign(x: Node) -> Node:
    below = node("select", FLOAT, node("lt", BOOL, x, ZERO), ZERO, number(-1.0, FLOAT))
    return node("select", FLOAT, node("gt", BOOL, x, ZERO), below, ONE)


def _power(run: Arrays, equation: Equation) -> np.ndarray:
    power = equation.params["y"]

    def raised(x: Node) -> Node:
        product = functools.reduce(functools.partial(_float, "mul"), [x] * abs(power)) if power else ONE
        return product if power >= 0 else _float("div", ONE, product)

    return _map(run.alike(equation.inputs, equation.outputs[0].shape), raised)


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
    return run.closed(atom).reshape(_known(var.shape))


def _slice(run: Arrays, equation: Equation) -> np.ndarray:
    array, params = run.array(equation.inputs[0]), equation.params
    strides = params["strides"] or (1,) * array.ndim
    cuts = []
    for axis, cut in enumerate(zip(params["start_indices"], params["limit_indices"], strides, strict=True)):
        whole = equation.inputs[0].shape[axis]
        if array.shape[axis] != 1 or _is_one(whole):
            cuts.append(slice(*cut))
            continue
        cuts.append(slice(None))
        first, _, step = cut
        if run.is_open(equation.inputs[0]) and (first, step) != (0, 1):
            at = node("add", INT, node("mul", INT, INDEX, number(step, INT)), number(first, INT))
            array = _placed(array, at)
        if _is_one(equation.outputs[0].shape[axis]):
            array = _placed(array, number(0, INT))
    return array[tuple(cuts)]


def _placed(array: np.ndarray, at: Node) -> np.ndarray:
    memo: dict[Node, Node] = {}
    return _map([array], lambda one: placed(one, at, memo))


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
    if array.shape[axis] == 1 and not _is_one(atom.shape[axis]):
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
        if any(array.shape[axis] == 1 and not _is_one(atom.shape[axis]) for axis in axes):
            array = run.closed(atom)
        rest = [axis for axis in range(array.ndim) if axis not in axes]
        rows = array.transpose(*axes, *rest).reshape(-1, *(array.shape[axis] for axis in rest))
        both = functools.partial(node, operator, var.dtype)
        return np.asarray(functools.reduce(lambda a, b: _map([a, b], both), list(rows)), object)

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
        _added, (_map([x, y], functools.partial(_float, "mul")) for x, y in zip(spread, b, strict=True))
    )


def _added(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return _map([a, b], functools.partial(_float, "add"))


def _by_function(run: Arrays, matrix: np.ndarray, vector: Atom) -> np.ndarray:
    source = run.filled(_known(vector.shape)[0], list(run.array(vector).flat))
    name = f"v{len(run.arrays)}"
    run.arrays[name] = Product(name, run.table(matrix), matrix.shape, run.arrays[source])
    if len(matrix) <= WRITTEN_OUT // 8:
        return _objects([_element(name, i, FLOAT) for i in range(len(matrix))], (len(matrix),))
    return _objects([leaf(f"{name}[@]")], (1,))


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
    result = np.empty(_known(var.shape), object)
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
    if len(row) == 1 and not _is_one(full):
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
    **{name: _elementwise(name) for name in ("add", "sub", "mul", "div", "max", "min", "neg", "rem", "and", "or")},
    **{name: _elementwise(name) for name in ("eq", "ne", "lt", "le", "gt", "ge", "not", *FUNCTIONS)},
    "logistic": _composed(lambda x: _float("div", ONE, _float("add", ONE, _float("exp", _float("neg", x))))),
    "rsqrt": _composed(lambda x: _float("div", ONE, _float("sqrt", x))),
    "square": _composed(lambda x: _float("mul", x, x)),
    "sign": _composed(_sign),
    "rev": lambda run, equation: np.flip(run.closed(equation.inputs[0]), equation.params["dimensions"]),
    "clamp": _composed(lambda low, x, high: _float("min", _float("max", x, low), high)),
    "integer_pow": _power,
    "select_n": _elementwise("select"),
    "convert_element_type": _elementwise("cast"),
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
    "dim_as_value": lambda run, equation: _objects([leaf("num_gates", INT)], ()),
    "dot_general": _product,
    "top_k": _top,
    "reduce_sum": _reduce("add"),
    "reduce_max": _reduce("max"),
    "reduce_min": _reduce("min"),
    "reduce_or": _reduce("or"),
    "reduce_and": _reduce("and"),
}
