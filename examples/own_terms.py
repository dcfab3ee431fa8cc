"""Terms of one's own: a drone that knows how fast it is and how its opponent's gates count, and is paid for smoothness.

cruise train --terms examples/own_terms.py --observation informed --drones 2
cruise race --terms examples/own_terms.py --policy runs/ring-2-s0
"""

import jax.numpy as jnp

from cruise import Observation, RewardTerm, Setting, Term, find_observation
from cruise.vector import norm


def lead(view):
    """Gates passed beyond the best opponent's, [N, *B]."""
    passed = view.state.gates_passed
    others = [jnp.roll(passed, -k, axis=0) for k in range(1, view.num_drones)]
    return passed - jnp.max(jnp.stack(others), axis=0) if others else jnp.zeros_like(passed)


def informed(setting: Setting):
    """The extended observation, then two terms."""
    return (
        *find_observation("extended").terms_for(setting),
        Term("speed", 1, "own speed", "m/s", scale=10.0, low=0.0, fn=lambda view: norm(view.velocity_w)),
        Term("lead", 1, "gates passed beyond the best opponent's", scale=5.0, fn=lead),
    )


OBSERVATIONS = [Observation("informed", informed, action_frame="gate", about="As `extended`, with speed and lead.")]
REWARDS = [
    RewardTerm("effort", "interaction", -0.01, lambda step: norm(step.action) ** 2, "the square of the action"),
]
