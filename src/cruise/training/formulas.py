"""The two equations of PPO, one function each. The one library that has them brings a nightly build of TensorFlow's."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def generalised_advantages(
    reward: Float[Array, "T *B"],
    discount: Float[Array, "T *B"],
    decay: Float[Array, "T *B"],
    value: Float[Array, "T1 *B"],
) -> Float[Array, "T *B"]:
    """Truncated generalised advantage estimates (Schulman et al., ICLR 2016, eq. 11 and 16; PPO, 2017, eq. 11 and 12).

    A_t = delta_t + gamma_t lambda_t A_{t+1} with delta_t = r_t + gamma_t V(s_{t+1}) - V(s_t) and A_T = 0. `discount`
    is gamma_t, `decay` is lambda_t: 0 where an episode ends at step t. `value` has one row more, that of the state
    after the last step.
    """
    delta = reward + discount * value[1:] - value[:-1]

    def back(following: Array, row: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        delta, discount, decay = row
        advantage = delta + discount * decay * following
        return advantage, advantage

    nothing = jnp.zeros(reward.shape[1:], reward.dtype)
    advantage: Array = jax.lax.scan(back, nothing, (delta, discount, decay), reverse=True)[1]
    return advantage


def clipped_surrogate(ratio: Float[Array, "*B"], advantage: Float[Array, "*B"], clip: float) -> Float[Array, "*B"]:
    """PPO's clipped objective (Schulman et al., 2017, eq. 7) of every step, negative: its mean is a loss.

    L = - min(r A, clip(r, 1 - epsilon, 1 + epsilon) A), where r is the probability of an action under the new
    policy over that under the old one. The advantage is a constant: no gradient goes through it.
    """
    advantage = jax.lax.stop_gradient(advantage)
    clipped = jnp.clip(ratio, 1.0 - clip, 1.0 + clip)
    return -jnp.minimum(ratio * advantage, clipped * advantage)
