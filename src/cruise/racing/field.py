"""Every drone against every other.

Opponent k of drone i is drone (i + k) mod N. Rolled so, one pass over k = 1 .. N - 1 meets every opponent of every
drone in fused loops over drones and races, and does no work for a drone against itself.
"""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

UNROLLED = 12  # drones up to which a loop over opponents is written out; with more it is a scan


def opponent(values: Array, k: int, axis: int) -> Array:
    """`values` of every drone's opponent k, in place of its own."""
    return jnp.roll(values, -k, axis=axis)


def all_opponents(values: Array, axis: int) -> Array:
    """`values` of all N - 1 opponents of every drone, along a new axis before that of the drones."""
    drones = values.shape[axis]
    if drones > UNROLLED:
        _, rolled = jax.lax.scan(lambda v, _: (v := opponent(v, 1, axis), v), values, length=drones - 1)
        return jnp.moveaxis(rolled, 0, axis)
    return jnp.stack([opponent(values, k, axis) for k in opponents(drones)], axis=axis)


def opponents(num_drones: int) -> Iterator[int]:
    """Numbers of a drone's opponents."""
    return iter(range(1, num_drones))


def over_opponents(visit: Callable[..., Any], start: Any, *values: tuple[Array, int]) -> Any:
    """Fold a function over the opponents of every drone, in order of k.

    What is traced does not grow with the number of drones: beyond `UNROLLED` of them it is a scan, to the same numbers.

    Args:
        visit: `visit(result, k, *theirs) -> result`, with `theirs` each of `values` as it is of opponent k.
        start: the result before the first opponent, a pytree of arrays whose shapes and types `visit` keeps.
        values: each with the number of its drone axis.
    """
    axes = [axis for _, axis in values]
    arrays = [array for array, _ in values]
    drones = arrays[0].shape[axes[0]]
    if drones <= UNROLLED:
        for k in opponents(drones):
            start = visit(start, k, *(opponent(array, k, axis) for array, axis in zip(arrays, axes, strict=True)))
        return start

    def step(carry: tuple[Any, list[Array]], k: Array) -> tuple[tuple[Any, list[Array]], None]:
        result, theirs = carry
        theirs = [opponent(array, 1, axis) for array, axis in zip(theirs, axes, strict=True)]
        return (visit(result, k, *theirs), theirs), None

    (result, _), _ = jax.lax.scan(step, (start, arrays), jnp.arange(1, drones))
    return result


def rows(values: Array, drones: tuple[int, ...], axis: int) -> Array:
    """The entries of some drones along the drone axis; no gather where they are next to each other."""
    if drones == tuple(range(values.shape[axis])):
        return values
    if drones == tuple(range(drones[0], drones[0] + len(drones))):
        return jax.lax.slice_in_dim(values, drones[0], drones[0] + len(drones), axis=axis)
    return values.take(jnp.array(drones), axis=axis)
