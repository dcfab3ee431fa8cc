"""Pilots that make things happen."""

import equinox as eqx
import jax
import jax.numpy as jnp

from cruise.pilots.scripted import SCRIPTED, Chaser
from cruise.racing.field import rows


class Steady(eqx.Module):
    """The same vertical action always, and a little noise."""

    name: str = eqx.field(static=True)
    up: float = eqx.field(static=True, default=0.0)
    noise: float = eqx.field(static=True, default=0.05)
    agility: float = eqx.field(static=True, default=7.5)
    vehicle: str = eqx.field(static=True, default="paper")

    def init(self, env, drones, state):
        return ()

    def act(self, env, drones, memory, state, key):
        shape = (3, *rows(state.next_gate, drones, 0).shape)
        noise = self.noise * jax.random.uniform(key, shape, minval=-1.0)
        return memory, noise.at[2].add(jnp.float32(self.up))


RACER = Chaser(name="racer", speed=5.5, agility=9.0)
# Two that fly too fast for the gates, one that races well, one that tumbles, one that sinks, one that climbs.
TROUBLE = [
    RACER,
    SCRIPTED["chaser"],
    RACER,
    Steady("tumbler", noise=1.0, agility=60.0),
    Steady("sinker", up=-0.2),
    Steady("climber", up=0.6),
]
