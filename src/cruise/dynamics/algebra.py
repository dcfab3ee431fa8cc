"""What the equations of motion need beside arithmetic, so that the same ones run on JAX's arrays and on other numbers.

Functions that take an `algebra` compute on whatever it is of: arrays of JAX by default, symbols of CasADi in
`cruise.limit`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp

from cruise.vector import sin_cos


class Algebra(NamedTuple):
    """Functions of one kind of numbers, named as NumPy names them."""

    stack: Callable[[list[Any]], Any]  # components as one vector, which can be unpacked, added and scaled
    sin_cos: Callable[[Any], tuple[Any, Any]]
    sqrt: Callable[[Any], Any]
    maximum: Callable[[Any, Any], Any]
    clip: Callable[[Any, float, float], Any]
    where: Callable[[Any, Any, Any], Any]
    zeros_like: Callable[[Any], Any]


JAX = Algebra(jnp.stack, sin_cos, jnp.sqrt, jnp.maximum, jnp.clip, jnp.where, jnp.zeros_like)
