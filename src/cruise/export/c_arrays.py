"""A program's arrays as NumPy arrays of scalar expressions: whatever moves numbers about costs nothing in C.

An axis may be open: it has length 1 and its expression holds the index, that of a gate in the caller's table or of a
loop. So tables of any length and the layers of a network stay loops, and all else is written out.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cruise.errors import CruiseError
from cruise.export.c_expressions import Node, leaf, number
from cruise.export.program import Atom, Equation, Var


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

    def array(self, atom: Atom) -> np.ndarray:
        """Expressions of a variable or constant."""
        if isinstance(atom, Var):
            return self.values[atom]
        return objects([number(value, atom.dtype) for value in atom.ravel()], atom.shape)

    def is_open(self, atom: Atom) -> bool:
        """Whether an axis of it holds the index."""
        return isinstance(atom, Var) and any(one.index for one in self.values[atom].flat)

    def closed(self, atom: Atom) -> np.ndarray:
        """Expressions of every place of it."""
        given = self.array(atom)
        if not self.is_open(atom):
            return np.broadcast_to(given, known(atom.shape))
        (size,) = (full for full, here in zip(known(atom.shape), given.shape, strict=True) if full != here)
        name = self.filled(size, list(given.flat))
        return objects([element(name, i, atom.dtype) for i in range(size)], known(atom.shape))

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
        axis = next(i for i, size in enumerate(shape) if opened[0].shape[i] == 1 and not is_one(size))
        if any(
            not self.is_open(a) and long(b, axis) and isinstance(a, Var) for a, b in zip(atoms, arrays, strict=True)
        ):
            return [self.closed(atom) for atom in atoms]
        return [self._opened(a, b, axis) if long(b, axis) else b for a, b in zip(atoms, arrays, strict=True)]

    def _opened(self, atom: Atom, array: np.ndarray, axis: int) -> np.ndarray:
        if isinstance(atom, Var):
            return array
        if atom.size != atom.shape[axis]:
            raise CruiseError("a table of constants of two axes cannot be exported to C")
        if (atom == atom.flat[0]).all():
            return array.ravel()[:1].reshape([1] * atom.ndim)
        return objects([leaf(f"{self.table(atom.ravel())}[@]")], (1,) * atom.ndim)


def long(array: np.ndarray, axis: int) -> bool:
    """Whether the array has an axis of more places than one."""
    return array.ndim > axis and array.shape[axis] != 1


def is_one(size: Any) -> bool:
    """Whether a size is known and 1."""
    return isinstance(size, int) and size == 1


def known(shape: Sequence[Any]) -> tuple[int, ...]:
    """A shape without open sizes. Raises CruiseError where one is open."""
    if not all(isinstance(size, int) for size in shape):
        raise CruiseError("the C header needs to know the number of gates")
    return tuple(shape)


def objects(nodes: Sequence[Node], shape: Sequence[int]) -> np.ndarray:
    """An array of expressions."""
    array = np.empty(len(nodes), object)
    array[:] = nodes
    return array.reshape(shape)


def element(name: str, place: int, kind: np.dtype) -> Node:
    """A place of an array of C."""
    return leaf(f"{name}[{place}]", kind)


Rule = Callable[[Arrays, Equation], Any]


def mapped(arrays: Sequence[Any], function: Callable[..., Node]) -> np.ndarray:
    """A function of expressions, place by place; NumPy broadcasts."""
    result = np.frompyfunc(function, len(arrays), 1)(*arrays)
    return np.asarray(result, object)
