"""CasADi's symbols in place of JAX's arrays, for the equations of `cruise.dynamics`."""

from collections.abc import Iterable
from typing import Any

import casadi as ca

from cruise.dynamics.algebra import Algebra


class Vector(tuple[Any, ...]):
    """Components that add and scale as an array does; symbols of CasADi cannot be unpacked."""

    def __new__(cls, components: Iterable[Any]) -> "Vector":
        """Of numbers or symbols."""
        return super().__new__(cls, components)

    def __add__(self, other: Any) -> "Vector":
        """Sum with another vector."""
        return Vector(a + b for a, b in zip(self, other, strict=True))

    def __sub__(self, other: Any) -> "Vector":
        """Difference from another vector."""
        return Vector(a - b for a, b in zip(self, other, strict=True))

    def __mul__(self, factor: Any) -> "Vector":
        """Times a number."""
        return Vector(a * factor for a in self)

    __rmul__ = __mul__


def parts(symbol: ca.SX, *slices: slice) -> list[Any]:
    """Slices of a column of symbols, each as its components, a `Vector`."""
    return [Vector(ca.vertsplit(symbol[part])) for part in slices]


def flat(values: Iterable[Any]) -> ca.SX:
    """Numbers and vectors behind each other, as one column."""
    return ca.vertcat(*(x for value in values for x in (value if isinstance(value, tuple) else (value,))))


def smooth(corner: float = 0.0, root: float = 0.0) -> Algebra:
    """An algebra of symbols without corners, which an optimiser cannot see round.

    Args:
        corner: half-width over which a maximum is rounded, in the unit of what is compared.
        root: what is added under a square root, which has no slope at zero, in the unit of what is under it.
    """
    return Algebra(
        stack=Vector,
        sin_cos=lambda angle: (ca.sin(angle), ca.cos(angle)),
        sqrt=lambda value: ca.sqrt(value + root),
        maximum=lambda a, b: (a + b + ca.sqrt((a - b) ** 2 + corner**2)) / 2,
        clip=lambda value, _low, _high: value,  # the optimiser's bounds keep it between
        where=lambda _condition, value, _other: value,  # and its angles away from where they are singular
        zeros_like=lambda _: 0.0,
    )
