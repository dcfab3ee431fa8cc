"""Tracing a function: its equations, without what its outputs do not need."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal
from jaxtyping import Array

from cruise.export.program import Atom, Equation, Program, Var
from cruise.export.simplify import simplified
from cruise.vector import plain

NESTED = ("jaxpr", "call_jaxpr", "fun_jaxpr")  # where a primitive keeps a function that it calls once
LOOPS = ("scan", "while", "cond")
OWN = "own"  # the function below, which is simplified as it stands


@jax.jit
def own(values: Array) -> Array:
    """[C, N, *B] -> [C, *B]: what is the first drone's."""
    return values[:, 0]


def trace(function: Callable[..., Any], inputs: Mapping[str, jax.ShapeDtypeStruct]) -> Program:
    """The equations of a function from a dictionary of arrays to a dictionary of arrays."""
    with plain():
        closed, shapes = jax.make_jaxpr(function, return_shape=True)(dict(inputs))
    given = [Var(inputs[name].shape, inputs[name].dtype) for name in sorted(inputs)]  # leaves are in order of the keys
    flat = _Flat()
    outputs = flat.run(closed.jaxpr, closed.consts, given)
    named = dict(zip(sorted(shapes), outputs, strict=True))
    return simplified(Program(dict(zip(sorted(inputs), given, strict=True)), named, tuple(flat.equations)))


class _Flat:
    """Calls are replaced by what they call, what depends on constants alone by its value."""

    def __init__(self) -> None:
        self.equations: list[Equation] = []
        self.known: dict[Any, Atom] = {}

    def run(self, jaxpr: Jaxpr, consts: Iterable[Any], arguments: Iterable[Atom]) -> list[Atom]:
        """What the outputs are for these arguments."""
        self.known |= dict(zip(jaxpr.constvars, map(np.asarray, consts), strict=True))
        self.known |= dict(zip(jaxpr.invars, arguments, strict=True))
        for equation in jaxpr.eqns:
            inputs = tuple(map(self._atom, equation.invars))
            self.known |= dict(zip(equation.outvars, self._outputs(equation, inputs), strict=True))
        return list(map(self._atom, jaxpr.outvars))

    def _atom(self, atom: Any) -> Atom:
        if isinstance(atom, Literal):
            shaped: Any = atom.aval
            return np.asarray(atom.val, shaped.dtype)
        return self.known[atom]

    def _outputs(self, equation: Any, inputs: tuple[Atom, ...]) -> Iterable[Atom]:
        name, params = equation.primitive.name, equation.params
        inner = next((params[key] for key in NESTED if key in params), None)
        if params.get("name") == OWN:
            return self._append(OWN, inputs, [Var(var.aval.shape, var.aval.dtype) for var in equation.outvars], {})
        if inner is not None and name not in LOOPS:
            closed = inner if isinstance(inner, ClosedJaxpr) else ClosedJaxpr(inner, ())
            return self.run(closed.jaxpr, closed.consts, inputs)
        constant = name != "dim_as_value" and all(isinstance(atom, np.ndarray) for atom in inputs)
        if constant and all(map(_of_known_size, equation.outvars)):
            values = equation.primitive.bind(*inputs, **params)
            return map(np.asarray, values if equation.primitive.multiple_results else [values])
        if name == "split":
            return self._pieces(inputs[0], map(int, params["sizes"]), params["axis"])
        if name == "gather" and isinstance(inputs[1], np.ndarray) and inputs[1].ndim == 1:
            return [self._part(inputs[0], inputs[1], params)]
        return self._append(name, inputs, [Var(var.aval.shape, var.aval.dtype) for var in equation.outvars], params)

    def _append(self, name: str, inputs: tuple[Atom, ...], outputs: list[Var], params: dict[str, Any]) -> list[Var]:
        plainly = {key: value.item() if isinstance(value, np.integer) else value for key, value in params.items()}
        self.equations.append(Equation(name, inputs, tuple(outputs), plainly))
        return outputs

    def _pieces(self, table: Atom, sizes: Iterable[int], axis: int) -> Iterable[Var]:
        """What lies one after the other along an axis is as many slices."""
        first, limit = [0] * table.ndim, list(table.shape)
        for size in sizes:
            limit[axis] = first[axis] + size
            shape = (*table.shape[:axis], size, *table.shape[axis + 1 :])
            cut = {"start_indices": tuple(first), "limit_indices": tuple(limit), "strides": None}
            yield from self._append("slice", (table,), [Var(shape, table.dtype)], cut)
            first[axis] = limit[axis]

    def _part(self, table: Atom, where: np.ndarray, params: dict[str, Any]) -> Var:
        """A look-up at a place that is known is a slice."""
        numbers, sizes = params["dimension_numbers"], params["slice_sizes"]
        first = [0] * len(sizes)
        for axis, place in zip(numbers.start_index_map, where.tolist(), strict=True):
            first[axis] = place
        cut = {"start_indices": first, "limit_indices": [a + b for a, b in zip(first, sizes, strict=True)]}
        (part,) = self._append("slice", (table,), [Var(sizes, table.dtype)], cut | {"strides": None})
        gone = numbers.collapsed_slice_dims
        left = tuple(size for axis, size in enumerate(sizes) if axis not in gone)
        return self._append("squeeze", (part,), [Var(left, table.dtype)], {"dimensions": gone})[0]


def _of_known_size(var: Any) -> bool:
    return all(isinstance(size, int) for size in var.aval.shape)
