"""Spaces with true bounds."""

import gymnasium
import jax
import numpy as np

from cruise.adapters.options import Setup
from cruise.env.observation_layout import Entry, observation_layout


def layout_of(setup: Setup) -> tuple[Entry, ...]:
    """What the numbers of the observation are, in their order."""
    env = setup.env
    size = jax.eval_shape(lambda key: env.observe(env.reset(key)), jax.random.key(0)).shape[0]
    return observation_layout(setup.observation, env.num_drones, len(setup.track.gates), setup.vehicle.name, size)


def observation_box(setup: Setup) -> gymnasium.spaces.Box:
    """[O] float32; bounds are those to which the observation is clipped."""
    entries = layout_of(setup)
    low, high = (
        np.concatenate([np.full(entry.size, getattr(entry, end), np.float32) for entry in entries])
        for end in ("low", "high")
    )
    return gymnasium.spaces.Box(low, high, dtype=np.float32)


def action_box(setup: Setup) -> gymnasium.spaces.Box:
    """[A] float32 in [-1, 1]."""
    return gymnasium.spaces.Box(-1.0, 1.0, (setup.env.dynamics.action_size,), np.float32)
