"""A track as arrays. Components lead and drones or races trail, so every function broadcasts over them."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from cruise.config import Track
from cruise.vector import is_plain


class Course(NamedTuple):
    """Gates and limits of a track [m, rad, world frame]. Where races differ in their gates, these have batch axes."""

    position_w: Float[Array, "3 G *B"]
    normal_w: Float[Array, "2 G *B"]  # (cos yaw, sin yaw): the direction of flight
    half_size: Float[Array, "2 G"]  # half width and half height of the openings
    frame_width: Float[Array, ""]
    bounds_low: Float[Array, "3"]
    bounds_high: Float[Array, "3"]
    leave_distance: Float[Array, ""]

    @property
    def num_gates(self) -> int:
        """Number of gates in a lap."""
        return self.position_w.shape[1]


def make_course(track: Track) -> Course:
    """Arrays of a track."""
    yaw = np.array([g.yaw for g in track.gates])
    return Course(
        position_w=jnp.array([g.position_w for g in track.gates], jnp.float32).T,
        normal_w=jnp.array([np.cos(yaw), np.sin(yaw)], jnp.float32),
        half_size=jnp.array([[g.width / 2, g.height / 2] for g in track.gates], jnp.float32).T,
        frame_width=jnp.float32(track.frame_width),
        bounds_low=jnp.array(track.bounds_low, jnp.float32),
        bounds_high=jnp.array(track.bounds_high, jnp.float32),
        leave_distance=jnp.float32(track.leave_distance),
    )


def pick(table: Float[Array, "C G *R"], gate: Int[Array, "*B"]) -> Float[Array, "C *B"]:
    """Columns of `table` at `gate`, axes R the last of B. A sum over selects: it vectorises where a gather does not."""
    races = table.shape[2:]
    if is_plain() and not races:
        return table.take(gate, axis=1, mode="clip")
    ones = (1,) * (gate.ndim - len(races))
    columns = [table[:, g].reshape(-1, *ones, *races) for g in range(table.shape[1])]
    picked = jnp.broadcast_to(columns[0], (table.shape[0], *gate.shape))
    for g, column in enumerate(columns[1:], start=1):
        picked = jnp.where(gate == g, column, picked)
    return picked
