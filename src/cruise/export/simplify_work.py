"""Equations of a program while it is simplified."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from cruise.export.pick import Picker
from cruise.export.program import Atom, Equation, Var


class Work:
    """Equations so far, and what stands for the variables of the old ones."""

    def __init__(self, rules: "Mapping[str, Rule]") -> None:
        """`rules` say what an equation of a primitive comes to, if to something shorter."""
        self.rules = rules
        self.equations: list[Equation] = []
        self.instead: dict[Var, Atom] = {}
        self.source: dict[Var, Equation] = {}
        self.known: dict[Any, tuple[Var, ...]] = {}
        self.picker = Picker(self.one, lambda atom: self.source.get(atom) if isinstance(atom, Var) else None)

    def now(self, atom: Atom) -> Atom:
        """What stands for a variable of the old program."""
        return self.instead.get(atom, atom) if isinstance(atom, Var) else atom

    def add(self, equation: Equation) -> None:
        """The next equation of the old program."""
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
        rule = self.rules.get(name)
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
        return is_constant(made.inputs[0] if made else atom, 0)

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


def is_constant(atom: Atom, value: float) -> bool:
    """Whether it is this number everywhere."""
    return isinstance(atom, np.ndarray) and bool((atom == value).all())


def alike(atom: Atom, var: Var) -> bool:
    """Whether it is a variable of the same shape and type."""
    return isinstance(atom, Var) and str(atom.shape) == str(var.shape) and atom.dtype == var.dtype


Rule = Callable[[Work, Equation], Atom | None]
