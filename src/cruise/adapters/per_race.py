"""Functions of many races, whose last axis they are, as functions of one race that `jax.vmap` makes many again.

Left to itself, `vmap` would put the races first, where a processor is slower, and would compute both sides of every
condition. So it is told what to do: hand all races to the function of many.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array

Function = Callable[..., Any]  # of trees of arrays


def of_one_race(many: Function) -> Function:
    """The function for a race alone: no array has the axis of the races."""
    merged = _nested(many)

    @custom_vmap
    def one(*trees: Any) -> Any:
        return _each(lambda a: a[..., 0], merged(*_each(lambda a: a[..., None], trees)))

    @one.def_vmap
    def rule(size: int, batched: Any, *trees: Any) -> tuple[Any, Any]:
        given = jax.tree.map(lambda a, b: _races_last(a, b, size), trees, tuple(batched))
        out = _each(lambda a: jnp.moveaxis(a, -1, 0), merged(*given))
        return out, _each(lambda _: True, out)

    return one


def _nested(many: Function) -> Function:
    """The function itself; under another `vmap` it takes all races of all batches at once."""

    @custom_vmap
    def function(*trees: Any) -> Any:
        return many(*trees)

    @function.def_vmap
    def rule(size: int, batched: Any, *trees: Any) -> tuple[Any, Any]:
        given = jax.tree.map(lambda a, b: _races_last(a, b, size), trees, tuple(batched))
        out = function(*_each(lambda a: a.reshape(*a.shape[:-2], -1), given))
        out = _each(lambda a: jnp.moveaxis(a.reshape(*a.shape[:-1], -1, size), -1, 0), out)
        return out, _each(lambda _: True, out)

    return function


def _races_last(array: Array, batched: bool, size: int) -> Array:
    return jnp.moveaxis(array, 0, -1) if batched else jnp.broadcast_to(array[..., None], (*array.shape, size))


def _each(function: Function, tree: Any) -> Any:
    return jax.tree.map(function, tree)
