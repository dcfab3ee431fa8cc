"""What is put together from pieces, put together more simply."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from cruise.export.program import Atom, Equation, Var
from cruise.export.simplify_work import Work, alike

NEUTRAL = {"mul": 1, "div": 1, "add": 0, "sub": 0}  # as the second number, and as the first where the order is free
FREE = ("mul", "add", "max", "min")  # in the order of their inputs
PIECEWISE = ("min", "max", "div", "mul")  # of pieces by a constant each, done once to what they make together


def concatenated(work: Work, equation: Equation) -> Atom | None:
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


def _runs(work: Work, parts: Sequence[Atom]) -> Iterable[Atom]:
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


def stacked(work: Work, equation: Equation) -> Atom | None:
    """All rows of an array are the array."""
    axis, (var,) = int(equation.params["axis"]), equation.outputs
    rows = [work.row_of(atom) for atom in equation.inputs]
    if (
        axis == 0
        and rows[0] is not None
        and alike(rows[0][0], var)
        and rows == [(rows[0][0], i) for i in range(len(rows))]
    ):
        return rows[0][0]
    return _at_once(work, equation, [1] * len(equation.inputs), axis)


def _at_once(work: Work, equation: Equation, sizes: Sequence[Any], axis: int) -> Atom | None:
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


def _piece(work: Work, name: str, atom: Atom) -> tuple[Atom, float | None]:
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
        and alike(value, made.outputs[0])
    ):
        return value, float(number.flat[0])
    return atom, None


def _column(pieces: Iterable[tuple[float, int]], axis: int, var: Var) -> np.ndarray:
    """The constants one below the other, or one for all."""
    numbers = np.concatenate([np.full(size, number, var.dtype) for number, size in pieces])
    if (numbers == numbers[0]).all():
        return np.asarray(numbers[0])
    return numbers.reshape([-1 if i == axis else 1 for i in range(var.ndim)])
