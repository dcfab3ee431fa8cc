"""Every drone against every other.

Opponent k of drone i is drone (i + k) mod N. Rolled so, one pass over k = 1 .. N - 1 meets every opponent of every
drone in fused loops over drones and races, and does no work for a drone against itself.
"""

from collections.abc import Iterator

import jax.numpy as jnp
from jaxtyping import Array


def opponent(values: Array, k: int, axis: int) -> Array:
    """`values` of every drone's opponent k, in place of its own."""
    return jnp.roll(values, -k, axis=axis)


def all_opponents(values: Array, axis: int) -> Array:
    """`values` of all N - 1 opponents of every drone, along a new axis before that of the drones."""
    return jnp.stack([opponent(values, k, axis) for k in opponents(values.shape[axis])], axis=axis)


def opponents(num_drones: int) -> Iterator[int]:
    """Numbers of a drone's opponents."""
    return iter(range(1, num_drones))


def rows(values: Array, drones: tuple[int, ...], axis: int) -> Array:
    """The entries of some drones along the drone axis; no gather where they are all drones."""
    if drones == tuple(range(values.shape[axis])):
        return values
    return values.take(jnp.array(drones), axis=axis)
