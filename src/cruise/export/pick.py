"""One of many along an axis, taken of what goes into an operation and not of what comes out."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cruise.export.program import Atom, Equation, Var

# Operations number by number.
NUMBERWISE = (
    *("abs", "acos", "add", "and", "asin", "atan", "atan2", "ceil", "clamp", "convert_element_type", "copy", "cos"),
    *("div", "eq", "erf", "exp", "floor", "ge", "gt", "integer_pow", "le", "log", "logistic", "lt", "max", "min"),
    *("mul", "ne", "neg", "not", "or", "pow", "rem", "round", "rsqrt", "select_n", "sign", "sin", "sqrt", "square"),
    *("stop_gradient", "sub", "tan", "tanh"),
)
Make = Callable[[str, Sequence[Atom], dict[str, Any], Var], Atom]  # name, inputs, parameters, output
Source = Callable[[Atom], Equation | None]


class Picker:
    """Takes one of many of variables whose equations are known."""

    def __init__(self, make: Make, source: Source) -> None:
        """`make` adds an equation, `source` knows that of a variable."""
        self.make, self.source = make, source
        self.done: dict[tuple[Var, int, int], Atom] = {}

    def pick(self, atom: Atom, axis: int, place: int) -> Atom:
        """`atom` at a place along an axis, which is gone."""
        if isinstance(atom, np.ndarray):
            return np.asarray(np.take(atom, 0 if atom.shape[axis] == 1 else place, axis))
        key = (atom, axis, place)
        if key not in self.done:
            made = self.source(atom)
            rule = RULES.get(made.primitive) if made else None
            shape = (*atom.shape[:axis], *atom.shape[axis + 1 :])
            found = rule(self, made, axis, place, Var(shape, atom.dtype)) if rule and made else None
            self.done[key] = self._cut(atom, axis, place, shape) if found is None else found
        return self.done[key]

    def _cut(self, atom: Var, axis: int, place: int, shape: Sequence[Any]) -> Atom:
        first = [0] * atom.ndim
        last, one = list(atom.shape), list(atom.shape)
        first[axis], last[axis], one[axis] = place, place + 1, 1
        cut = {"start_indices": tuple(first), "limit_indices": tuple(last), "strides": None}
        part = self.make("slice", [atom], cut, Var(one, atom.dtype))
        return self.make("squeeze", [part], {"dimensions": (axis,)}, Var(shape, atom.dtype))


Rule = Callable[[Picker, Equation, int, int, Var], Atom | None]


def _without(axes: Sequence[Any], axis: int) -> tuple[int, ...]:
    """Numbers of axes when one is gone."""
    return tuple(int(each) - (each > axis) for each in axes if each != axis)


def _each(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom:
    """Of all inputs alike."""
    inputs = [picker.pick(atom, axis, place) if atom.ndim else atom for atom in made.inputs]
    return picker.make(made.primitive, inputs, made.params, var)


def _broadcast(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom:
    (atom,), kept = made.inputs, tuple(map(int, made.params["broadcast_dimensions"]))
    if axis in kept:
        at = kept.index(axis)
        alone = isinstance(atom.shape[at], int) and atom.shape[at] == 1
        atom = picker.pick(atom, at, 0 if alone else place)
    return picker.make("broadcast_in_dim", [atom], {"broadcast_dimensions": _without(kept, axis)}, var)


def _concatenate(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom | None:
    along = int(made.params["dimension"])
    if along != axis:
        inputs = [picker.pick(atom, axis, place) for atom in made.inputs]
        return picker.make("concatenate", inputs, {"dimension": along - (along > axis)}, var)
    for atom in made.inputs:
        size = atom.shape[axis]
        if not isinstance(size, int):
            return None
        if place < size:
            return picker.pick(atom, axis, place)
        place -= size
    return None


def _stack(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom:
    along = int(made.params["axis"])
    if along == axis:
        return made.inputs[place]
    inputs = [picker.pick(atom, axis - (axis > along), place) for atom in made.inputs]
    return picker.make("stack", inputs, {"axis": along - (along > axis)}, var)


def _transpose(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom:
    order = tuple(map(int, made.params["permutation"]))
    atom = picker.pick(made.inputs[0], order[axis], place)
    return picker.make("transpose", [atom], {"permutation": _without(_dropped(order, axis), order[axis])}, var)


def _dropped(values: Sequence[Any], at: int) -> tuple[Any, ...]:
    return (*values[:at], *values[at + 1 :])


def _reduce(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom:
    (atom,), axes = made.inputs, tuple(map(int, made.params["axes"]))
    at = [each for each in range(atom.ndim) if each not in axes][axis]
    return picker.make(made.primitive, [picker.pick(atom, at, place)], made.params | {"axes": _without(axes, at)}, var)


def _squeeze(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom:
    (atom,), gone = made.inputs, tuple(map(int, made.params["dimensions"]))
    at = [each for each in range(atom.ndim) if each not in gone][axis]
    return picker.make("squeeze", [picker.pick(atom, at, place)], {"dimensions": _without(gone, at)}, var)


def _slice(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom | None:
    params = made.params
    strides = params["strides"] or (1,) * made.inputs[0].ndim
    if not isinstance(params["start_indices"][axis], int):
        return None
    atom = picker.pick(made.inputs[0], axis, int(params["start_indices"][axis]) + place * int(strides[axis]))
    cut = {name: _dropped(tuple(params[name]), axis) for name in ("start_indices", "limit_indices")}
    return picker.make("slice", [atom], cut | {"strides": _dropped(tuple(strides), axis)}, var)


def _reverse(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom | None:
    axes = tuple(map(int, made.params["dimensions"]))
    if axis in axes:
        return None
    return picker.make("rev", [picker.pick(made.inputs[0], axis, place)], {"dimensions": _without(axes, axis)}, var)


def _reshape(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom | None:
    """Where only axes before are others."""
    (atom,), (whole,) = made.inputs, made.outputs
    at = axis + atom.ndim - whole.ndim
    if at < 0 or str(atom.shape[at:]) != str(whole.shape[axis:]):
        return None
    return picker.make("reshape", [picker.pick(atom, at, place)], {"new_sizes": var.shape, "dimensions": None}, var)


def _gather(picker: Picker, made: Equation, axis: int, place: int, var: Var) -> Atom | None:
    (table, where), params, (whole,) = made.inputs, made.params, made.outputs
    numbers = params["dimension_numbers"]
    if len(numbers.start_index_map) != 1 or numbers.operand_batching_dims:
        return None
    offsets = tuple(map(int, numbers.offset_dims))
    if axis in offsets:
        kept = [each for each in range(table.ndim) if each not in numbers.collapsed_slice_dims]
        at = kept[offsets.index(axis)]
        if str(params["slice_sizes"][at]) != str(table.shape[at]):
            return None
        table = picker.pick(table, at, place)
        params = params | {"slice_sizes": _dropped(tuple(params["slice_sizes"]), at)}
        numbers = numbers._replace(
            collapsed_slice_dims=_without(numbers.collapsed_slice_dims, at),
            start_index_map=_without(numbers.start_index_map, at),
        )
    else:
        where = picker.pick(where, [each for each in range(whole.ndim) if each not in offsets].index(axis), place)
    numbers = numbers._replace(offset_dims=_without(offsets, axis))
    return picker.make("gather", [table, where], params | {"dimension_numbers": numbers}, var)


RULES: dict[str, Rule] = {
    **dict.fromkeys(NUMBERWISE, _each),
    **dict.fromkeys(("reduce_sum", "reduce_max", "reduce_min", "reduce_or", "reduce_and"), _reduce),
    "broadcast_in_dim": _broadcast,
    "concatenate": _concatenate,
    "stack": _stack,
    "transpose": _transpose,
    "squeeze": _squeeze,
    "slice": _slice,
    "rev": _reverse,
    "reshape": _reshape,
    "gather": _gather,
}
