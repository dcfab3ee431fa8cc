"""Proximal policy optimisation on the formulas of rlax and the optimisers of optax."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import optax
import rlax
from jaxtyping import Array, Float, Int

from cruise.config import PPOConfig
from cruise.pilots.network import ActorCritic
from cruise.training.experience import Experience, log_prob
from cruise.training.types import Batch, TrainState


def make_optimiser(config: PPOConfig, total_updates: int) -> optax.GradientTransformation:
    """Adam behind a clip of the gradient's norm, its rate falling linearly over the run.

    Flattened: one vector instead of a dozen small arrays, whose loops would cost more than their arithmetic.
    """
    gradient_steps = max(1, total_updates * config.epochs * config.minibatches)
    schedule = optax.linear_schedule(config.learning_rate, config.final_learning_rate, gradient_steps)
    return optax.flatten(optax.chain(optax.clip_by_global_norm(config.max_grad_norm), optax.adam(schedule, eps=1e-5)))


def advantages(experience: Experience, gamma: float, gae_lambda: float) -> Float[Array, "T E"]:
    """Generalised advantage estimates (Schulman et al., 2016) of every race.

    A crash has no future: its discount is 0. A time limit has one: it falls on the last step of a rollout, after
    which `last_value` is the value of the final observation.
    """
    transitions = experience.transitions
    discount = gamma * (1.0 - transitions.terminated)
    values = jnp.concatenate([transitions.value, experience.last_value[None]])
    estimate = jax.vmap(rlax.truncated_generalized_advantage_estimation, in_axes=(1, 1, None, 1), out_axes=1)
    return estimate(transitions.reward, discount, gae_lambda, values)


def make_batch(experience: Experience, config: PPOConfig) -> Batch:
    """Add advantages and value targets to the transitions."""
    advantage = advantages(experience, config.gamma, config.gae_lambda)
    t = experience.transitions
    return Batch(t.observation, t.action, t.log_prob, advantage, advantage + t.value)


def ppo_loss(
    model: ActorCritic, batch: Batch, config: PPOConfig, entropy_weight: Array
) -> tuple[Array, dict[str, Array]]:
    """Clipped surrogate + value error - entropy, over a minibatch whose components lead."""
    mean = model.mean_action(batch.observation)
    value = model.value(batch.observation)
    new_log_prob = log_prob(mean, model.log_std, batch.action)
    log_ratio = new_log_prob - batch.log_prob
    advantage = (batch.advantage - batch.advantage.mean()) / (batch.advantage.std() + 1e-8)
    policy_loss = rlax.clipped_surrogate_pg_loss(jnp.exp(log_ratio), advantage, config.clip_ratio)
    value_loss = optax.l2_loss(value, batch.value_target).mean()
    entropy = (model.log_std + 0.5 * jnp.log(2 * jnp.pi * jnp.e)).sum()
    loss = policy_loss + config.value_weight * 2 * value_loss - entropy_weight * entropy
    metrics = {
        "loss/policy": policy_loss,
        "loss/value": value_loss,
        "policy/entropy": entropy,
        "policy/kl": jnp.mean(jnp.expm1(log_ratio) - log_ratio),
    }
    return loss, metrics


def _side_by_side(rows: Float[Array, "T *C E"], chosen: Int[Array, "K"]) -> Float[Array, "*C KE"]:
    """The chosen time steps, joined along the races: one long batch axis, copied row by row."""
    picked = [jax.lax.dynamic_index_in_dim(rows, chosen[i], keepdims=False) for i in range(chosen.shape[0])]
    return jnp.concatenate(picked, axis=-1)


def make_learn(
    config: PPOConfig, optimiser: optax.GradientTransformation, total_updates: int
) -> Callable[[TrainState, Experience], tuple[TrainState, dict[str, Array]]]:
    """A function that improves the model on one rollout.

    A minibatch is a random set of time steps of all races: races are independent, so it is nearly as mixed as a full
    shuffle, and it is gathered by rows of E numbers instead of one by one.
    """
    steps_per_minibatch = config.rollout_steps // config.minibatches

    exploration = optax.linear_schedule(config.entropy_weight, 0.0, total_updates)

    def learn_minibatch(carry: tuple, minibatch: Batch, entropy_weight: Array) -> tuple:
        model, opt_state = carry
        gradient, metrics = jax.grad(ppo_loss, has_aux=True)(model, minibatch, config, entropy_weight)
        updates, opt_state = optimiser.update(gradient, opt_state, model)
        return (optax.apply_updates(model, updates), opt_state), metrics

    def learn(state: TrainState, experience: Experience) -> tuple[TrainState, dict[str, Array]]:
        batch = make_batch(experience, config)
        key, shuffle_key = jax.random.split(state.key)
        entropy_weight = exploration(state.updates)

        def minibatch_step(carry: tuple, chosen: Array) -> tuple:
            return learn_minibatch(carry, jax.tree.map(lambda x: _side_by_side(x, chosen), batch), entropy_weight)

        def epoch(carry: tuple, epoch_key: Array) -> tuple:
            order = jax.random.permutation(epoch_key, config.rollout_steps)
            return jax.lax.scan(minibatch_step, carry, order.reshape(config.minibatches, steps_per_minibatch))

        keys = jax.random.split(shuffle_key, config.epochs)
        metrics: dict[str, Array]
        (model, opt_state), metrics = jax.lax.scan(epoch, (state.model, state.optimiser), keys)
        state = state._replace(model=model, optimiser=opt_state, key=key, updates=state.updates + 1)
        return state, {name: values.mean() for name, values in metrics.items()}

    return learn
