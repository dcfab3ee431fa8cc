"""A program with fewer equations that gives the same: what is done twice, undone, or done piece by piece."""

from collections.abc import Iterable

import numpy as np

from cruise.export.program import Atom, Equation, Program, Var
from cruise.export.simplify_joins import FREE, NEUTRAL, concatenated, stacked
from cruise.export.simplify_work import Rule, Work, alike, is_constant


def simplified(program: Program) -> Program:
    """The program without what its outputs do not need, and with the rest said shortly."""
    work = Work(RULES)
    for equation in program.equations:
        work.add(equation)
    outputs = {name: work.now(atom) for name, atom in program.outputs.items()}
    return Program(program.inputs, outputs, _needed(work.equations, outputs.values()))


def _arithmetic(work: Work, equation: Equation) -> Atom | None:
    """Of constants and signs; numbers are finite."""
    (var,), name, (first, second) = equation.outputs, equation.primitive, equation.inputs
    neutral = NEUTRAL[name]
    if name == "mul" and is_constant(first, -1):
        return work.one("neg", [second], {}, var)
    if name == "add" and (negated := work.made_by(second, "neg")) is not None:
        return work.one("sub", [first, *negated.inputs], {}, var)
    if name == "mul" and (is_constant(first, 0) or is_constant(second, 0)):
        zero = np.zeros((), var.dtype)
        return work.one("broadcast_in_dim", [zero], {"broadcast_dimensions": ()}, Var(var.shape, var.dtype))
    for one, other in ((first, second), (second, first)) if name in FREE else ((first, second),):
        if alike(one, var) and (is_constant(other, neutral) or (neutral == 0 and work.is_zero(other))):
            return one
    if name == "sub" and work.is_zero(first) and alike(second, var):
        return work.one("neg", [second], {}, Var(var.shape, var.dtype))
    return _moved(work, equation)


def _logic(work: Work, equation: Equation) -> Atom | None:
    """Or nothing, and all, not not."""
    if equation.primitive == "not":
        twice = work.made_by(equation.inputs[0], "not")
        return twice.inputs[0] if twice else None
    for one, other in (equation.inputs, equation.inputs[::-1]):
        made = work.made_by(one, "broadcast_in_dim")
        if is_constant(made.inputs[0] if made else one, equation.primitive == "and") and alike(
            other, equation.outputs[0]
        ):
            return other
    return None


def _moved(work: Work, equation: Equation) -> Atom | None:
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


def _product(work: Work, equation: Equation) -> Atom | None:
    """A layer of a batch along the last axis, as runtimes know it: the batch first."""
    (left, right), (var,), (contracted, batch) = equation.inputs, equation.outputs, equation.params["dimension_numbers"]
    if not isinstance(left, np.ndarray) or (left.ndim, right.ndim) != (2, 2) or contracted != ((1,), (0,)) or batch[0]:
        return None
    rows = work.one("transpose", [right], {"permutation": (1, 0)}, Var(right.shape[::-1], right.dtype))
    params = equation.params | {"dimension_numbers": (((1,), (0,)), ((), ()))}
    done = work.one("dot_general", [rows, np.ascontiguousarray(left.T)], params, Var(var.shape[::-1], var.dtype))
    return work.one("transpose", [done], {"permutation": (1, 0)}, Var(var.shape, var.dtype))


def _unchanged(work: Work, equation: Equation) -> Atom | None:
    del work
    return equation.inputs[0] if alike(equation.inputs[0], equation.outputs[0]) else None


def _slice(work: Work, equation: Equation) -> Atom | None:
    """All of an array, or one of those that it was put together from."""
    ((atom,), (var,)), params = equation[1:3], equation.params
    starts, limits = params["start_indices"], params["limit_indices"]
    plain = all(step == 1 for step in params["strides"] or ())
    if plain and alike(atom, var) and all(str(first) == "0" for first in starts):
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


def _own(work: Work, equation: Equation) -> Atom:
    """Of the first drone alone: what only others need is left out."""
    return work.picker.pick(equation.inputs[0], 1, 0)


def _transpose(work: Work, equation: Equation) -> Atom | None:
    """Of a transposed array: at once, or not at all."""
    (atom,), (var,), order = equation.inputs, equation.outputs, tuple(map(int, equation.params["permutation"]))
    before = work.made_by(atom, "transpose")
    if order == tuple(range(len(order))):
        return atom
    if before is None:
        return None
    both = tuple(int(before.params["permutation"][axis]) for axis in order)
    return work.one("transpose", before.inputs, {"permutation": both}, Var(var.shape, var.dtype))


def _broadcast(work: Work, equation: Equation) -> Atom | None:
    """What is of that shape already, or was made so in two steps."""
    (atom,), (var,), kept = equation.inputs, equation.outputs, tuple(map(int, equation.params["broadcast_dimensions"]))
    if kept == tuple(range(var.ndim)) and alike(atom, var):
        return atom
    before = work.made_by(atom, "broadcast_in_dim")
    if before is None:
        return None
    both = tuple(kept[int(axis)] for axis in before.params["broadcast_dimensions"])
    return work.one("broadcast_in_dim", before.inputs, {"broadcast_dimensions": both}, Var(var.shape, var.dtype))


def _gather(work: Work, equation: Equation) -> Atom | None:
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
    "concatenate": concatenated,
    "stack": stacked,
}


def _needed(equations: list[Equation], outputs: Iterable[Atom]) -> tuple[Equation, ...]:
    wanted = {id(atom) for atom in outputs}
    kept = []
    for equation in reversed(equations):
        if any(id(var) in wanted for var in equation.outputs):
            kept.append(equation)
            wanted |= {id(atom) for atom in equation.inputs}
    return tuple(reversed(kept))
