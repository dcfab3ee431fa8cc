"""Spaces with true bounds."""

import gymnasium
import numpy as np

from cruise.adapters.options import Setup
from cruise.terms import Entry


def layout_of(setup: Setup) -> tuple[Entry, ...]:
    """What the numbers of the observation are, in their order."""
    return setup.env.layout(setup.observation)


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
