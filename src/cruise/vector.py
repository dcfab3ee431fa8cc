"""Vector arithmetic on arrays whose leading axis holds the components, written for fused vector loops.

XLA on the CPU turns a sum over a short leading axis into a scalar loop, and sine and cosine into scalar calls; written
out component by component the same arithmetic runs 10 to 20 times faster (`benchmarks`).
"""

import contextlib
import functools
import operator
from collections.abc import Callable, Iterator
from contextvars import ContextVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_PLAIN = ContextVar("plain", default=False)


@contextlib.contextmanager
def plain() -> Iterator[None]:
    """Trace what is written out here for XLA as the one operation that it is, for an export to other programs."""
    token = _PLAIN.set(True)
    try:
        yield
    finally:
        _PLAIN.reset(token)


def is_plain() -> bool:
    """Whether the tracing that goes on is for an export."""
    return _PLAIN.get()


def dot(a: Float[Array, "D *B"], b: Float[Array, "D *B"]) -> Float[Array, "*B"]:
    """Scalar product over the leading axis."""
    if is_plain():
        return jnp.sum(a * b, axis=0)
    return fold(operator.add, a * b)


def norm(a: Float[Array, "D *B"]) -> Float[Array, "*B"]:
    """Euclidean length over the leading axis."""
    return jnp.sqrt(dot(a, a))


def fold(combine: Callable[[Array, Array], Array], rows: Array) -> Array:
    """Reduce the short leading axis with a binary function, row by row."""
    return functools.reduce(combine, [rows[i] for i in range(rows.shape[0])])


# pi / 2 as a sum of three floats of few bits, so that x - n pi / 2 is exact for |n| < 2^13 (Cody and Waite, 1980).
_HALF_PI = (1.5703125, 4.837512969970703e-4, 7.549789948768648e-8)


def sin_cos(angle: Float[Array, "*B"]) -> tuple[Float[Array, "*B"], Float[Array, "*B"]]:
    """Sine and cosine of an angle [rad], within 2e-7 for |angle| < 1000.

    Reduction to [-pi/4, pi/4] and Taylor-like minimax polynomials of degree 7 and 8 (Moshier, Cephes `sinf`, `cosf`).
    """
    if is_plain():
        return jnp.sin(angle), jnp.cos(angle)
    quadrant = jnp.round(angle * (2 / jnp.pi))
    a, b, c = _HALF_PI
    x = ((angle - quadrant * a) - quadrant * b) - quadrant * c
    x2 = x * x
    sine = x + x * x2 * (-1.6666654611e-1 + x2 * (8.3321608736e-3 - x2 * 1.9515295891e-4))
    cosine = (
        1.0 - 0.5 * x2 + x2 * x2 * (4.166664568298827e-2 + x2 * (-1.388731625493765e-3 + x2 * 2.443315711809948e-5))
    )
    q = quadrant.astype(jnp.int32)
    swap = (q & 1) == 1
    sin_value = jnp.where(swap, cosine, sine)
    cos_value = jnp.where(swap, sine, cosine)
    return jnp.where((q & 2) == 2, -sin_value, sin_value), jnp.where(((q + 1) & 2) == 2, -cos_value, cos_value)


def once(flag: Bool[Array, "*B"]) -> Bool[Array, "*B"]:
    """The same flag, computed once.

    XLA's fusion on the CPU computes a cheap producer again inside each of its consumers, however long its chain; what
    it counts as expensive, a square root among them, it computes once and stores.
    """
    return flag if is_plain() else jnp.sqrt(flag.astype(jnp.float32)) > 0


def stored(number: Float[Array, "*B"]) -> Float[Array, "*B"]:
    """The same number, computed once: to `once` what numbers are to flags, by a division that counts as expensive.

    For the waist of a long calculation with many results, which would otherwise be computed anew for each of them.
    Infinite becomes not a number.
    """
    return number if is_plain() else number / (number * 0.0 + 1.0)
