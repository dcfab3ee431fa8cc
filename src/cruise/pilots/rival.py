"""Opponents whose behaviour is known: what pilots are measured against."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Vehicle
from cruise.dynamics import Reference
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.pilots.base import Memory
from cruise.pilots.scripted import EPSILON, Chaser, aim_point
from cruise.racing.course import pick
from cruise.racing.field import rows
from cruise.vector import norm


class Rival(eqx.Module):
    """Chases gates in a lane of its own and looks at nobody; where it is told to, it falls out of the sky.

    Every number is an array that broadcasts over [N, *B], so that races with different rivals are one batch.
    """

    speed: Float[Array, "..."]  # [m/s]
    lane: Float[Array, "..."]  # left of the middle of every gate [m]
    falls_after: Float[Array, "..."]  # so many gates, when it is near the next; infinite: never
    agility: float = eqx.field(static=True)
    vehicle: str | Vehicle = eqx.field(static=True)
    velocity_gain: float = eqx.field(static=True)
    name: str = eqx.field(static=True, default="rival")
    near: float = eqx.field(static=True, default=4.0)  # [m]

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """No memory."""
        del env, drones, state
        return ()

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """Track the velocity that leads through its lane of the gate."""
        del key
        position = state.drones.position_w
        wanted = self.speed * self._direction(env, state)
        to_gate = norm(pick(env.course_of(state).position_w, state.next_gate) - position)
        falls = (state.gates_passed >= self.falls_after) & (to_gate < self.near)
        down = jnp.stack([0 * to_gate, 0 * to_gate, jnp.broadcast_to(-self.speed, to_gate.shape)])
        reference = Reference(velocity_w=jnp.where(falls, down, wanted), velocity_gain=self.velocity_gain)
        return memory, rows(env.dynamics.track(state.drones, reference, self.agility), drones, axis=1)

    def _direction(self, env: RaceEnv, state: RaceState) -> Float[Array, "3 N *B"]:
        course, position = env.course_of(state), state.drones.position_w
        normal = pick(course.normal_w, state.next_gate)
        aside = jnp.stack([-self.lane * normal[1], self.lane * normal[0], 0 * normal[0]])
        to_aim = aim_point(course, state.next_gate, position - aside, Chaser().lead) - (position - aside)
        return to_aim / (norm(to_aim) + EPSILON)
