"""A pilot that looks at nothing: its actions are waves in time."""

import equinox as eqx
import jax.numpy as jnp

from cruise.vehicles import find_vehicle, reference_to


class Scheduled(eqx.Module):
    """Every drone of every race is told the same; it crashes within seconds."""

    name: str = eqx.field(static=True, default="scheduled")
    agility: float = eqx.field(static=True, default=7.5)
    vehicle: object = eqx.field(static=True, default="paper")

    def for_vehicle(self, vehicle):
        found = find_vehicle(vehicle)
        return Scheduled(self.name, found.agility, reference_to(found))

    def init(self, env, drones, state):
        return ()

    def act(self, env, drones, memory, state, key):
        waves = jnp.stack([0.3 * jnp.sin(0.7 * state.step + i) for i in range(env.dynamics.action_size)])
        return memory, jnp.broadcast_to(waves[:, None], (len(waves), len(drones), *state.step.shape))
