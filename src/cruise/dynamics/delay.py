"""Commands that take effect later than they are given."""

import math
from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.dynamics.parameters import Scalar


def commands_to_keep(delay: float, control_dt: float) -> int:
    """How many earlier commands can still be on their way, at least the one before."""
    return max(1, math.ceil(delay / control_dt - 1e-6))


def in_effect(
    commands: Sequence[Float[Array, "*B"]], delay: Scalar, elapsed: Array | float, control_dt: float, step: float
) -> Float[Array, "*B"]:
    """The command that acts `elapsed` [s] into a control step: the one given at `elapsed - delay`, held since.

    `commands` are this step's and those of the steps before, newest first. A delay is as good as rounded to whole
    sub-steps of `step` [s]; one longer than the commands reach back is as long as they do.
    """
    if isinstance(delay, float | int) and delay <= 0:
        return commands[0]
    behind = delay - elapsed
    acting = commands[0]
    for back, command in enumerate(commands[1:]):
        acting = jnp.where(behind > back * control_dt + step / 2, command, acting)
    return acting
