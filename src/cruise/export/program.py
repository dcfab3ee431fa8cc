"""A function as a flat list of equations."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np


class Var:
    """What an equation gives, or an input."""

    def __init__(self, shape: Sequence[Any], dtype: Any) -> None:
        """`shape` may have sizes that are known only when the program runs."""
        self.shape, self.dtype = tuple(shape), np.dtype(dtype)
        self.ndim = len(self.shape)


Atom = Var | np.ndarray  # of an equation: a variable or a constant


class Equation(NamedTuple):
    """A primitive operation of JAX."""

    primitive: str
    inputs: tuple[Atom, ...]
    outputs: tuple[Var, ...]
    params: dict[str, Any]


class Program(NamedTuple):
    """Inputs and outputs by name, and what leads from the ones to the others, in order."""

    inputs: dict[str, Var]
    outputs: dict[str, Atom]
    equations: tuple[Equation, ...]

    @property
    def used(self) -> frozenset[str]:
        """Names of the inputs that outputs depend on."""
        read = {id(atom) for equation in self.equations for atom in equation.inputs}
        read |= {id(atom) for atom in self.outputs.values()}
        return frozenset(name for name, var in self.inputs.items() if id(var) in read)
