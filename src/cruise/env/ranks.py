"""Who is nearest, without a sort."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from cruise.racing.field import UNROLLED


def ranks(values: list[Float[Array, "*B"]]) -> list[Int[Array, "*B"]]:
    """Place of each value in ascending order, ties in order of the list.

    By counting, because XLA's sort calls its comparison element by element on the CPU. With many values that is a scan,
    so that what is traced does not grow with the square of their number.
    """
    if len(values) >= UNROLLED:
        return list(counted_ranks(jnp.stack(values)))
    places = [jnp.zeros(v.shape, jnp.int32) for v in values]
    for i in range(len(values)):
        for j in range(i + 1, len(values)):
            later_first = (values[j] < values[i]).astype(jnp.int32)
            places[i] += later_first
            places[j] += 1 - later_first
    return places


def counted_ranks(values: Float[Array, "K *B"]) -> Int[Array, "K *B"]:
    """`ranks` of many values: for every value, how many are smaller, or equal and before it."""
    number = jnp.arange(values.shape[0]).reshape(-1, *(1,) * (values.ndim - 1))

    def step(places: Array, other: Array) -> tuple[Array, None]:
        first = (values[other] < values) | ((values[other] == values) & (other < number))
        return places + first.astype(jnp.int32), None

    places, _ = jax.lax.scan(step, jnp.zeros(values.shape, jnp.int32), jnp.arange(values.shape[0]))
    return places


def counted(values: Float[Array, "K *B"]) -> Int[Array, "K *B"]:
    """`ranks` along the leading axis as few operations on whole arrays: for an export."""
    before = jnp.less(values[None], values[:, None])
    first = np.tri(len(values), k=-1, dtype=bool).reshape(len(values), -1, *(1,) * (values.ndim - 1))
    return (before | (jnp.equal(values[None], values[:, None]) & first)).sum(axis=1, dtype=jnp.int32)
