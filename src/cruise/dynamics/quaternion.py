"""Attitude as a unit quaternion (w, x, y, z), Hamilton's, that turns vectors of the body into the world's.

Functions take the components one by one, as arrays over whatever axes: see `cruise.vector` for why.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cruise.vector import is_plain, sin_cos

Component = Any  # an array over whatever axes, or a number of another algebra (`cruise.dynamics.algebra`)
Three = tuple[Component, Component, Component]
Four = tuple[Component, Component, Component, Component]
Vector = Any  # three components: a tuple of arrays [*B], or an array [3, *B]
Quaternion = Any  # four of them, likewise

NEARLY_VERTICAL = 1 - 1e-6  # sine of the pitch beyond which roll and yaw are one turn


def from_heading(heading: Float[Array, "*B"]) -> Float[Array, "4 *B"]:
    """Level, the body's x axis towards `heading` [rad]."""
    sine, cosine = sin_cos(heading / 2)
    zero = jnp.zeros_like(heading)
    return jnp.stack([cosine, zero, zero, sine])


def from_euler(roll: Component, pitch: Component, yaw: Component) -> Four:
    """The attitude Rz(yaw) Ry(pitch) Rx(roll), from ZYX Euler angles [rad]."""
    (sr, cr), (sp, cp), (sy, cy) = sin_cos(roll / 2), sin_cos(pitch / 2), sin_cos(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def between(q: Quaternion, wanted: Quaternion) -> Four:
    """Give q^-1 wanted: the rotation, in the body's frame, that is left to turn."""
    (w, x, y, z), (a, b, c, d) = q, wanted
    return (
        w * a + x * b + y * c + z * d,
        w * b - x * a - y * d + z * c,
        w * c + x * d - y * a - z * b,
        w * d - x * c + y * b - z * a,
    )


def up_b(q: Quaternion) -> Three:
    """The world's z axis in the body's frame: the last row of `rotation_matrix`."""
    w, x, y, z = q
    return 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


def derivative(q: Quaternion, angular_velocity_b: Vector) -> Four:
    """Give q (0, omega) / 2 (Diebel, Representing Attitude, 2006)."""
    w, x, y, z = q
    p, r, s = angular_velocity_b
    return (
        -0.5 * (x * p + y * r + z * s),
        0.5 * (w * p + y * s - z * r),
        0.5 * (w * r + z * p - x * s),
        0.5 * (w * s + x * r - y * p),
    )


def normalise(q: Quaternion) -> Four:
    """Length one again, which an integrator keeps only to its order."""
    w, x, y, z = q
    shrink = 1 / jnp.sqrt(w * w + x * x + y * y + z * z)
    return w * shrink, x * shrink, y * shrink, z * shrink


def turned(q: Float[Array, "4 *B"], rotation_b: Float[Array, "3 *B"]) -> Float[Array, "4 *B"]:
    """Give q (1, tan(v / 2)): turned on about the body's axes by v [rad], exactly so where v lies along one of them.

    Otherwise to second order. Angles beyond 1 rad count as 1 rad.
    """
    turn = derivative(q, 2 * jnp.tan(jnp.clip(rotation_b, -1.0, 1.0) / 2))
    return jnp.stack(list(normalise(q + jnp.stack(list(turn)))))


def thrust_axis_w(q: Quaternion) -> Three:
    """The body's z axis in the world."""
    w, x, y, z = q
    return 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)


# R_WB - 1 as a sum of two products of components each, for an export: few operations on whole arrays.
_LEFT = np.array([[[2, 1, 1], [1, 1, 2], [1, 2, 1]], [[3, 0, 0], [0, 3, 0], [0, 0, 2]]])
_RIGHT = np.array([[[2, 2, 3], [2, 1, 3], [3, 3, 1]], [[3, 3, 2], [3, 3, 1], [2, 1, 2]]])
_FACTORS = np.array([[[-2, 2, 2], [2, -2, 2], [2, 2, -2]], [[-2, -2, 2], [2, -2, -2], [-2, 2, -2]]], np.float32)


def rotation_matrix(q: Float[Array, "4 *B"]) -> Float[Array, "3 3 *B"]:
    """R_WB: its columns are the body's axes in the world."""
    if is_plain():
        ones = (1,) * (q.ndim - 1)
        products = _FACTORS.reshape(2, 3, 3, *ones) * (q[_LEFT] * q[_RIGHT])
        return np.eye(3, dtype=np.float32).reshape(3, 3, *ones) + products.sum(axis=0)
    w, x, y, z = q
    forward = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    left = [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)]
    up = thrust_axis_w((w, x, y, z))
    return jnp.stack([jnp.stack(list(row)) for row in zip(forward, left, up, strict=True)])


def to_euler(q: Float[Array, "4 *B"]) -> Float[Array, "3 *B"]:
    """Roll, pitch, yaw (ZYX) [rad]; at a pitch of 90 degrees, where only their sum means anything, roll is 0."""
    w, x, y, z = q
    sine = jnp.clip(2 * (w * y - x * z), -1.0, 1.0)
    vertical = jnp.abs(sine) > NEARLY_VERTICAL
    roll = jnp.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw = jnp.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    turn = jnp.arctan2(2 * w * z, w * w - z * z)
    return jnp.stack([jnp.where(vertical, 0.0, roll), jnp.arcsin(sine), jnp.where(vertical, turn, yaw)])
