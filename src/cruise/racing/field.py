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


def opponents(num_drones: int) -> Iterator[int]:
    """Numbers of a drone's opponents."""
    return iter(range(1, num_drones))
