"""Proximal policy optimisation: minibatches, losses and steps of the optimiser."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int, Shaped

from cruise.config import PPOConfig
from cruise.pilots.network import ActorCritic
from cruise.training.devices import mean_over_devices
from cruise.training.experience import Experience, log_prob
from cruise.training.formulas import clipped_surrogate, generalised_advantages
from cruise.training.types import Batch, TrainState

LEAST_DEVIATION = 0.01  # of a group's advantages, as a share of that of all: that of one or two may be rounding


def make_optimiser(config: PPOConfig, total_updates: int) -> optax.GradientTransformation:
    """Adam behind a clip of the gradient's norm, its rate falling linearly over the run."""
    gradient_steps = max(1, total_updates * config.epochs * config.minibatches)
    schedule = optax.linear_schedule(config.learning_rate, config.final_learning_rate, gradient_steps)
    return optax.chain(optax.clip_by_global_norm(config.max_grad_norm), optax.adam(schedule, eps=1e-5))


def exploration_schedule(config: PPOConfig, total_updates: int) -> optax.Schedule:
    """Weight of the entropy bonus by update: full, then falling linearly, then none."""
    hold, end = (round(share * total_updates) for share in (config.entropy_hold, config.entropy_end))
    return optax.linear_schedule(config.entropy_weight, 0.0, max(1, end - hold), hold)


def flatten(model: ActorCritic) -> Float[Array, "P"]:
    """All parameters as one vector, which is what the optimiser sees.

    A dozen small arrays would cost more loops, and between devices more messages, than their arithmetic is worth.
    """
    return ravel_pytree(model)[0]


def advantages(experience: Experience, config: PPOConfig) -> Float[Array, "T E"]:
    """Generalised advantage estimates (Schulman et al., 2016) of every race.

    After a crash comes the value of the next start, or with `after_crash="nothing"` none; never what happens there. A
    time limit falls on the last step of a rollout, after which `last_value` is the value of the final observation.
    """
    transitions = experience.transitions
    going_on = 1.0 - transitions.terminated
    future = going_on if config.after_crash == "nothing" else jnp.ones_like(going_on)
    values = jnp.concatenate([transitions.value, experience.last_value[None]])
    return generalised_advantages(transitions.reward, config.gamma * future, config.gae_lambda * going_on, values)


def make_batch(experience: Experience, config: PPOConfig) -> Batch:
    """Add advantages and value targets to the transitions."""
    advantage = advantages(experience, config)
    t = experience.transitions
    return Batch(t.observation, t.action, t.noise_scale, t.in_company, t.log_prob, advantage, advantage + t.value)


def ppo_loss(
    model: ActorCritic, batch: Batch, config: PPOConfig, entropy_weight: Array
) -> tuple[Array, dict[str, Array]]:
    """Clipped surrogate + value error - entropy, over a minibatch, components leading, advantages standardised."""
    mean, value = model.mean_and_value(batch.observation)
    new_log_prob = log_prob(mean, model.log_std, batch.action, batch.noise_scale)
    log_ratio = new_log_prob - batch.log_prob
    policy_loss = clipped_surrogate(jnp.exp(log_ratio), batch.advantage, config.clip_ratio)
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


def _side_by_side(rows: Shaped[Array, "T *C E"], chosen: Int[Array, "K"]) -> Shaped[Array, "*C KE"]:
    """The chosen time steps, joined along the races: one long batch axis, copied row by row."""
    picked = [jax.lax.dynamic_index_in_dim(rows, chosen[i], keepdims=False) for i in range(chosen.shape[0])]
    return jnp.concatenate(picked, axis=-1)


def _ceiling(model: ActorCritic, max_log_std: float) -> Float[Array, "P"]:
    """The largest value of every parameter: only the deviations have one.

    The environment clips actions, so that beyond some width more noise costs nothing, and the entropy bonus would widen
    it for ever.
    """
    unbounded = jax.tree.map(lambda leaf: jnp.full_like(leaf, jnp.inf), model)
    return flatten(eqx.tree_at(lambda m: m.log_std, unbounded, jnp.full_like(model.log_std, max_log_std)))


def _moments(advantage: Float[Array, "T E"], axis: str | None) -> Float[Array, "2 T"]:
    """Mean and mean square of every time step's advantages, over all races on all devices."""
    return mean_over_devices(jnp.stack([advantage.mean(1), (advantage**2).mean(1)]), axis)


def _moments_among(advantage: Float[Array, "T E"], group: Bool[Array, "T E"], axis: str | None) -> Float[Array, "3 T"]:
    """The same of those in a group, with the others as zeros, and the group's share."""
    shares = group.astype(jnp.float32)
    return jnp.concatenate([_moments(shares * advantage, axis), mean_over_devices(shares.mean(1), axis)[None]])


def _moments_of_groups(batch: Batch, config: PPOConfig, axis: str | None) -> tuple[Array, ...]:
    """Of all advantages; where company counts, of those without and of those with."""
    if config.company_distance == 0:
        return (_moments(batch.advantage, axis),)
    groups = ~batch.in_company, batch.in_company
    return tuple(_moments_among(batch.advantage, group, axis) for group in groups)


def _deviation(moments: Float[Array, "2"]) -> Float[Array, ""]:
    mean, square = moments
    return jnp.sqrt(jnp.maximum(square - mean**2, 0.0))


def _standardised(
    advantage: Float[Array, "*B"], moments: Float[Array, "2"], least: Array | float = 0.0
) -> Float[Array, "*B"]:
    """With mean 0 and deviation 1, or smaller where they deviate by less than `least`."""
    return (advantage - moments[0]) / (jnp.maximum(_deviation(moments), least) + 1e-8)


def _minibatch(batch: Batch, moments: tuple[Array, ...], chosen: Int[Array, "K"]) -> Batch:
    """The chosen time steps of all races, advantages standardised over the whole minibatch, on whatever device.

    With the moments of two groups, what happens in company is standardised apart from what happens alone: beside an
    opponent one crash outweighs whatever a better line is worth, and standardised by it lines are hardly learned.
    """
    picked: Batch = jax.tree.map(lambda rows: _side_by_side(rows, chosen), batch)
    chosen_moments = [rows[:, chosen].mean(1) for rows in moments]
    if len(moments) == 1:
        return picked._replace(advantage=_standardised(picked.advantage, chosen_moments[0]))
    least = LEAST_DEVIATION * _deviation(chosen_moments[0][:2] + chosen_moments[1][:2])
    alone, company = (_standardised(picked.advantage, m[:2] / jnp.maximum(m[2], 1e-8), least) for m in chosen_moments)
    return picked._replace(advantage=jnp.where(picked.in_company, company, alone))


def make_learn(
    config: PPOConfig, optimiser: optax.GradientTransformation, total_updates: int, axis: str | None = None
) -> Callable[[TrainState, Experience, Array], tuple[TrainState, dict[str, Array]]]:
    """A function that improves the model on one rollout, given a random key for the order of the minibatches.

    A minibatch is a random set of time steps of all races: races are independent, so it is nearly as mixed as a full
    shuffle, and it is gathered by rows of E numbers instead of one by one. Where the races are spread over the devices
    of a mesh axis, every device holds its own and the gradients are averaged.
    """
    steps_per_minibatch = config.rollout_steps // config.minibatches
    exploration = exploration_schedule(config, total_updates)

    def learn(state: TrainState, experience: Experience, shuffle_key: Array) -> tuple[TrainState, dict[str, Array]]:
        batch = make_batch(experience, config)
        moments = _moments_of_groups(batch, config, axis)
        entropy_weight = exploration(state.updates)
        parameters, unflatten = ravel_pytree(state.model)
        most = _ceiling(state.model, config.max_log_std)

        def loss(parameters: Array, minibatch: Batch) -> tuple[Array, dict[str, Array]]:
            return ppo_loss(unflatten(parameters), minibatch, config, entropy_weight)

        def minibatch_step(carry: tuple, chosen: Array) -> tuple:
            parameters, opt_state = carry
            gradient, metrics = jax.grad(loss, has_aux=True)(parameters, _minibatch(batch, moments, chosen))
            gradient = mean_over_devices(gradient, axis)
            updates, opt_state = optimiser.update(gradient, opt_state, parameters)
            parameters = jnp.minimum(optax.apply_updates(parameters, updates), most)
            return (parameters, opt_state), metrics

        def epoch(carry: tuple, epoch_key: Array) -> tuple:
            order = jax.random.permutation(epoch_key, config.rollout_steps)
            return jax.lax.scan(minibatch_step, carry, order.reshape(config.minibatches, steps_per_minibatch))

        keys = jax.random.split(shuffle_key, config.epochs)
        metrics: dict[str, Array]
        (parameters, opt_state), metrics = jax.lax.scan(epoch, (parameters, state.optimiser), keys)
        state = state._replace(model=unflatten(parameters), optimiser=opt_state, updates=state.updates + 1)
        return state, {name: values.mean() for name, values in metrics.items()}

    return learn
