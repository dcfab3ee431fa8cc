"""Spaces with true bounds."""

import itertools

import gymnasium
import numpy as np

from cruise.adapters.options import Choices

KEYS = (
    ("w", "s"),
    ("a", "d"),
    ("r", "f"),
    ("q", "e"),
)  # more and less of each number of an action: of directions forward, left, up; yaw last
KEYS_OF_THRUST = (
    ("r", "f"),
    ("d", "a"),
    ("w", "s"),
    ("q", "e"),
)  # collective thrust, roll to the right, pitch forward, yaw to the left


def observation_box(choices: Choices) -> gymnasium.spaces.Box:
    """[O] float32; bounds are those to which the observation is clipped."""
    low, high = (
        np.concatenate([np.full(entry.size, getattr(entry, end), np.float32) for entry in choices.layout])
        for end in ("low", "high")
    )
    return gymnasium.spaces.Box(low, high, dtype=np.float32)


def action_box(choices: Choices) -> gymnasium.spaces.Box:
    """[A] float32 in [-1, 1]."""
    return gymnasium.spaces.Box(-1.0, 1.0, (choices.action.size,), np.float32)


def keys_to_action(choices: Choices) -> dict[tuple[str, ...], np.ndarray]:
    """Full deflection of one number by key, or of two by two keys."""
    keys = KEYS if choices.action.frame == "world" else KEYS_OF_THRUST
    one: dict[str, np.ndarray] = {}
    for number, way in enumerate(np.eye(choices.action.size, dtype=np.float32)):
        one |= dict(zip(keys[number], (way, -way), strict=True))
    pairs = ((a, b) for a, b in itertools.combinations(one, 2) if (one[a] + one[b]).any())
    return {(key,): action for key, action in one.items()} | {(a, b): one[a] + one[b] for a, b in pairs}
