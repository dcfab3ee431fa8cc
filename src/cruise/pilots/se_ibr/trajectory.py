"""A plan in continuous time."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.dynamics import Reference


class Trajectory(NamedTuple):
    """What a plan wants, from where its drones were when it was made."""

    position_w: Float[Array, "3 K+1 N *B"]  # [m]
    velocity_w: Float[Array, "3 K+1 N *B"]  # [m/s]
    dt: float  # between two positions [s]

    def at(self, time: Array | float) -> Reference:
        """What is wanted `time` after the plan was made; [s], broadcast over [N, *B]. After its end the end counts."""
        slope = jnp.diff(self.velocity_w, axis=1) / self.dt
        acceleration = self._between(jnp.concatenate([slope, slope[:, -1:]], axis=1), jnp.floor(self._place(time)))
        return Reference(self._between(self.position_w, self._place(time)), self.velocity_at(time), acceleration)

    def velocity_at(self, time: Array | float) -> Float[Array, "3 N *B"]:
        """The velocity alone; see `at`."""
        return self._between(self.velocity_w, self._place(time))

    def _place(self, time: Array | float) -> Array:
        """Steps since the plan was made."""
        return jnp.clip(jnp.asarray(time) / self.dt, 0.0, self.position_w.shape[1] - 1.0)

    def _between(self, values: Array, place: Array) -> Array:
        """Values [3, K+1, N, *B] linearly interpolated at a place on their second axis."""
        number = jnp.arange(values.shape[1]).reshape(-1, *(1,) * (values.ndim - 2))
        return (values * jnp.maximum(1.0 - jnp.abs(place - number), 0.0)).sum(axis=1)


def make_trajectory(position_w: Array, velocity_w: Array, planned_w: Float[Array, "3 K N *B"], dt: float) -> Trajectory:
    """From the position [m] and velocity [m/s] at planning through the planned positions [m]."""
    position = jnp.concatenate([position_w[:, None], planned_w], axis=1)
    velocity = jnp.concatenate([velocity_w[:, None], jnp.diff(position, axis=1) / dt], axis=1)
    return Trajectory(position, velocity, dt)
