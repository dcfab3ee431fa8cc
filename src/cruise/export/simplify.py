"""A program with fewer equations that gives the same: what is done twice, undone, or done piece by piece."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from cruise.export.pick import Picker
from cruise.export.program import Atom, Equation, Program, Var

NEUTRAL = {"mul": 1, "div": 1, "add": 0, "sub": 0}  # as the second number, and as the first where the order is free
FREE = ("mul", "add", "max", "min")  # in the order of their inputs
PIECEWISE = ("min", "max", "div", "mul")  # of pieces by a constant each, done once to what they make together


def simplified(program: Program) -> Program:
    """The program without what its outputs do not need, and with the rest said shortly."""
    work = _Work()
    for equation in program.equations:
        work.add(equation)
    outputs = {name: work.now(atom) for name, atom in program.outputs.items()}
    return Program(program.inputs, outputs, _needed(work.equations, outputs.values()))


class _Work:
    """Equations so far, and what stands for the variables of the old ones."""

    def __init__(self) -> None:
        self.equations: list[Equation] = []
        self.instead: dict[Var, Atom] = {}
        self.source: dict[Var, Equation] = {}
        self.known: dict[Any, tuple[Var, ...]] = {}
        self.picker = Picker(self.one, lambda atom: self.source.get(atom) if isinstance(atom, Var) else None)

    def now(self, atom: Atom) -> Atom:
        return self.instead.get(atom, atom) if isinstance(atom, Var) else atom

    def add(self, equation: Equation) -> None:
        equation = equation._replace(inputs=tuple(map(self.now, equation.inputs)))
        if len(equation.outputs) == 1:
            (var,) = equation.outputs
            new = self.one(equation.primitive, equation.inputs, equation.params, var)
            if new is not var:
                self.instead[var] = new
        else:
            self._keep(equation)

    def one(self, name: str, inputs: Sequence[Atom], params: dict[str, Any], var: Var) -> Atom:
        """What an equation with one output, `var` if it is kept, comes to."""
        rule = RULES.get(name)
        equation = Equation(name, tuple(inputs), (var,), params)
        simpler = rule(self, equation) if rule else None
        return self._keep(equation)[0] if simpler is None else simpler

    def made_by(self, atom: Atom, name: str) -> Equation | None:
        """The equation of this name that gives it."""
        found = self.source.get(atom) if isinstance(atom, Var) else None
        return found if found is not None and found.primitive == name else None

    def is_zero(self, atom: Atom) -> bool:
        """Whether it is zero everywhere."""
        made = self.made_by(atom, "broadcast_in_dim")
        return _is_constant(made.inputs[0] if made else atom, 0)

    def row_of(self, atom: Atom) -> tuple[Var, int] | None:
        """An array and the number of a row, along its first axis, that this is."""
        squeeze = self.made_by(atom, "squeeze")
        cut = self.made_by(squeeze.inputs[0], "slice") if squeeze else None
        if squeeze is None or cut is None or tuple(squeeze.params["dimensions"]) != (0,):
            return None
        (table,), starts = cut.inputs, cut.params["start_indices"]
        if str(cut.outputs[0].shape[1:]) != str(table.shape[1:]) or not isinstance(table, Var):
            return None
        return table, int(starts[0])

    def _keep(self, equation: Equation) -> tuple[Var, ...]:
        made = [(str(var.shape), var.dtype.str) for var in equation.outputs]
        key = (equation.primitive, *map(_key, equation.inputs), repr(sorted(equation.params.items())), *made)
        if key not in self.known:
            self.known[key] = equation.outputs
            self.equations.append(equation)
            self.source |= dict.fromkeys(equation.outputs, equation)
        elif self.known[key] is not equation.outputs:
            self.instead |= dict(zip(equation.outputs, self.known[key], strict=True))
        return self.known[key]


def _key(atom: Atom) -> Any:
    return id(atom) if isinstance(atom, Var) else (atom.dtype.str, atom.shape, atom.tobytes())


def _arithmetic(work: _Work, equation: Equation) -> Atom | None:
    """Of constants and signs; numbers are finite."""
    (var,), name, (first, second) = equation.outputs, equation.primitive, equation.inputs
    neutral = NEUTRAL[name]
    if name == "mul" and _is_constant(first, -1):
        return work.one("neg", [second], {}, var)
    if name == "add" and (negated := work.made_by(second, "neg")) is not None:
        return work.one("sub", [first, *negated.inputs], {}, var)
    if name == "mul" and (_is_constant(first, 0) or _is_constant(second, 0)):
        zero = np.zeros((), var.dtype)
        return work.one("broadcast_in_dim", [zero], {"broadcast_dimensions": ()}, Var(var.shape, var.dtype))
    for one, other in ((first, second), (second, first)) if name in FREE else ((first, second),):
        if _alike(one, var) and (_is_constant(other, neutral) or (neutral == 0 and work.is_zero(other))):
            return one
    if name == "sub" and work.is_zero(first) and _alike(second, var):
        return work.one("neg", [second], {}, Var(var.shape, var.dtype))
    return _moved(work, equation)


def _logic(work: _Work, equation: Equation) -> Atom | None:
    """Or nothing, and all, not not."""
    if equation.primitive == "not":
        twice = work.made_by(equation.inputs[0], "not")
        return twice.inputs[0] if twice else None
    for one, other in (equation.inputs, equation.inputs[::-1]):
        made = work.made_by(one, "broadcast_in_dim")
        if _is_constant(made.inputs[0] if made else one, equation.primitive == "and") and _alike(
            other, equation.outputs[0]
        ):
            return other
    return None


def _moved(work: _Work, equation: Equation) -> Atom | None:
    """What is done number by number to transposed arrays is transposed afterwards."""
    (var,) = equation.outputs
    inputs, perm = list[Atom](), None
    for atom in equation.inputs:
        made = work.made_by(atom, "transpose")
        order = tuple(made.params["permutation"]) if made else None
        if isinstance(atom, np.ndarray):
            inputs.append(atom)
            continue
        if made is None or order is None or perm not in (None, order):
            return None
        perm = order
        inputs.append(made.inputs[0])
    if perm is None:
        return None
    back = np.argsort(perm)
    inputs = [atom.transpose(back) if isinstance(atom, np.ndarray) and atom.ndim else atom for atom in inputs]
    done = work.one(equation.primitive, inputs, equation.params, Var(tuple(var.shape[i] for i in back), var.dtype))
    return work.one("transpose", [done], {"permutation": perm}, Var(var.shape, var.dtype))


def _product(work: _Work, equation: Equation) -> Atom | None:
    """A layer of a batch along the last axis, as runtimes know it: the batch first."""
    (left, right), (var,), (contracted, batch) = equation.inputs, equation.outputs, equation.params["dimension_numbers"]
    if not isinstance(left, np.ndarray) or (left.ndim, right.ndim) != (2, 2) or contracted != ((1,), (0,)) or batch[0]:
        return None
    rows = work.one("transpose", [right], {"permutation": (1, 0)}, Var(right.shape[::-1], right.dtype))
    params = equation.params | {"dimension_numbers": (((1,), (0,)), ((), ()))}
    done = work.one("dot_general", [rows, np.ascontiguousarray(left.T)], params, Var(var.shape[::-1], var.dtype))
    return work.one("transpose", [done], {"permutation": (1, 0)}, Var(var.shape, var.dtype))


def _is_constant(atom: Atom, value: float) -> bool:
    return isinstance(atom, np.ndarray) and bool((atom == value).all())


def _alike(atom: Atom, var: Var) -> bool:
    return isinstance(atom, Var) and str(atom.shape) == str(var.shape) and atom.dtype == var.dtype


def _unchanged(work: _Work, equation: Equation) -> Atom | None:
    del work
    return equation.inputs[0] if _alike(equation.inputs[0], equation.outputs[0]) else None


def _slice(work: _Work, equation: Equation) -> Atom | None:
    """All of an array, or one of those that it was put together from."""
    ((atom,), (var,)), params = equation[1:3], equation.params
    starts, limits = params["start_indices"], params["limit_indices"]
    plain = all(step == 1 for step in params["strides"] or ())
    if plain and _alike(atom, var) and all(str(first) == "0" for first in starts):
        return atom
    joint = work.made_by(atom, "concatenate")
    if joint is None or not plain:
        return None
    axis, first = int(joint.params["dimension"]), 0
    if any(
        str(size) != str(full) for i, (size, full) in enumerate(zip(var.shape, atom.shape, strict=True)) if i != axis
    ):
        return None
    for part in joint.inputs:
        if (str(first), str(first + part.shape[axis])) == (str(starts[axis]), str(limits[axis])):
            return part
        first = first + part.shape[axis]
    return None


def _own(work: _Work, equation: Equation) -> Atom:
    """Of the first drone alone: what only others need is left out."""
    return work.picker.pick(equation.inputs[0], 1, 0)


def _transpose(work: _Work, equation: Equation) -> Atom | None:
    """Of a transposed array: at once, or not at all."""
    (atom,), (var,), order = equation.inputs, equation.outputs, tuple(map(int, equation.params["permutation"]))
    before = work.made_by(atom, "transpose")
    if order == tuple(range(len(order))):
        return atom
    if before is None:
        return None
    both = tuple(int(before.params["permutation"][axis]) for axis in order)
    return work.one("transpose", before.inputs, {"permutation": both}, Var(var.shape, var.dtype))


def _concatenate(work: _Work, equation: Equation) -> Atom | None:
    """Without what is empty; and what is done to every piece by a constant is done to all of them at once."""
    axis, (var,) = int(equation.params["dimension"]), equation.outputs
    parts = [atom for atom in equation.inputs if str(atom.shape[axis]) != "0"]
    if len(parts) == 1:
        return parts[0]
    parts = list(_runs(work, parts)) if axis == 0 else parts
    if len(parts) == 1:
        return parts[0]
    at_once = _at_once(work, equation._replace(inputs=tuple(parts)), [part.shape[axis] for part in parts], axis)
    if at_once is not None:
        return at_once
    if len(parts) < len(equation.inputs):
        return work.one("concatenate", parts, equation.params, Var(var.shape, var.dtype))
    return None


def _broadcast(work: _Work, equation: Equation) -> Atom | None:
    """What is of that shape already, or was made so in two steps."""
    (atom,), (var,), kept = equation.inputs, equation.outputs, tuple(map(int, equation.params["broadcast_dimensions"]))
    if kept == tuple(range(var.ndim)) and _alike(atom, var):
        return atom
    before = work.made_by(atom, "broadcast_in_dim")
    if before is None:
        return None
    both = tuple(kept[int(axis)] for axis in before.params["broadcast_dimensions"])
    return work.one("broadcast_in_dim", before.inputs, {"broadcast_dimensions": both}, Var(var.shape, var.dtype))


def _gather(work: _Work, equation: Equation) -> Atom | None:
    """Of neighbours: a slice. Of two arrays one behind the other: of the one that has them."""
    (table, where), (var,), params = equation.inputs, equation.outputs, equation.params
    numbers = params["dimension_numbers"]
    if not isinstance(where, np.ndarray) or where.ndim != 2 or len(numbers.start_index_map) != 1:
        return None
    axis, first = int(numbers.start_index_map[0]), int(where[0, 0])
    if numbers.operand_batching_dims or var.ndim != table.ndim or axis in numbers.offset_dims:
        return None
    if (where[:, 0] != np.arange(first, first + len(where))).any():
        return None
    starts, limits = [0] * table.ndim, list(table.shape)
    starts[axis], limits[axis] = first, first + len(where)
    cut = {"start_indices": tuple(starts), "limit_indices": tuple(limits), "strides": None}
    return work.one("slice", [table], cut, Var(var.shape, var.dtype))


def _runs(work: _Work, parts: Sequence[Atom]) -> Iterable[Atom]:
    """All rows of an array, one after the other, are the array, reshaped."""
    rows, place = [work.row_of(part) for part in parts], 0
    while place < len(parts):
        table, first = rows[place] or (None, 1)
        count = table.shape[0] if table is not None and first == 0 and isinstance(table.shape[0], int) else 1
        if (
            table is not None
            and count > 1
            and table.ndim > 1
            and rows[place : place + count] == [(table, i) for i in range(count)]
        ):
            shape = (count * table.shape[1], *table.shape[2:])
            yield work.one("reshape", [table], {"new_sizes": shape, "dimensions": None}, Var(shape, table.dtype))
        else:
            count = 1
            yield parts[place]
        place += count


def _stack(work: _Work, equation: Equation) -> Atom | None:
    """All rows of an array are the array."""
    axis, (var,) = int(equation.params["axis"]), equation.outputs
    rows = [work.row_of(atom) for atom in equation.inputs]
    if (
        axis == 0
        and rows[0] is not None
        and _alike(rows[0][0], var)
        and rows == [(rows[0][0], i) for i in range(len(rows))]
    ):
        return rows[0][0]
    return _at_once(work, equation, [1] * len(equation.inputs), axis)


def _at_once(work: _Work, equation: Equation, sizes: Sequence[Any], axis: int) -> Atom | None:
    """What is done to most pieces by a constant, to all of them together."""
    (var,) = equation.outputs
    for name in PIECEWISE:
        pieces = [_piece(work, name, part) for part in equation.inputs]
        done = sum(constant is not None for _, constant in pieces)
        if done == len(pieces) or (name in NEUTRAL and done > len(pieces) / 2):
            inner, whole = (Var(var.shape, var.dtype) for _ in range(2))
            numbers = [float(NEUTRAL[name]) if constant is None else constant for _, constant in pieces]
            table = _column(list(zip(numbers, sizes, strict=True)), axis, var)
            together = work.one(equation.primitive, [piece for piece, _ in pieces], equation.params, inner)
            return work.one(name, [together, table], {}, whole)
    return None


def _piece(work: _Work, name: str, atom: Atom) -> tuple[Atom, float | None]:
    """What is done `name` to by a constant number, and the number."""
    made = work.made_by(atom, name)
    if made is None:
        return atom, None
    pair = made.inputs if name not in FREE or isinstance(made.inputs[1], np.ndarray) else made.inputs[::-1]
    value, number = pair
    if (
        isinstance(number, np.ndarray)
        and number.size
        and (number == number.flat[0]).all()
        and _alike(value, made.outputs[0])
    ):
        return value, float(number.flat[0])
    return atom, None


def _column(pieces: Iterable[tuple[float, int]], axis: int, var: Var) -> np.ndarray:
    """The constants one below the other, or one for all."""
    numbers = np.concatenate([np.full(size, number, var.dtype) for number, size in pieces])
    if (numbers == numbers[0]).all():
        return np.asarray(numbers[0])
    return numbers.reshape([-1 if i == axis else 1 for i in range(var.ndim)])


Rule = Callable[[_Work, Equation], Atom | None]
RULES: dict[str, Rule] = {
    **dict.fromkeys(NEUTRAL, _arithmetic),
    **dict.fromkeys(("tanh", "max", "min"), _moved),
    **dict.fromkeys(("and", "or", "not"), _logic),
    "dot_general": _product,
    **dict.fromkeys(("copy", "stop_gradient", "convert_element_type", "reshape", "squeeze"), _unchanged),
    "slice": _slice,
    "own": _own,
    "broadcast_in_dim": _broadcast,
    "gather": _gather,
    "transpose": _transpose,
    "concatenate": _concatenate,
    "stack": _stack,
}


def _needed(equations: list[Equation], outputs: Iterable[Atom]) -> tuple[Equation, ...]:
    wanted = {id(atom) for atom in outputs}
    kept = []
    for equation in reversed(equations):
        if any(id(var) in wanted for var in equation.outputs):
            kept.append(equation)
            wanted |= {id(atom) for atom in equation.inputs}
    return tuple(reversed(kept))
