"""Proximal policy optimisation: minibatches, losses and steps of the optimiser."""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from cruise.config import PPOConfig
from cruise.pilots.network import ActorCritic
from cruise.training.devices import mean_over_devices
from cruise.training.experience import Experience, log_prob
from cruise.training.formulas import clipped_surrogate, generalised_advantages
from cruise.training.minibatches import make_minibatches
from cruise.training.types import Batch, TrainState

LAST_KL = 0.25  # of `target_kl`, at the end of a run
KL_BAND, RATE_STEP = 1.5, 1.3  # factor off the target that is let be; factor by which the rate follows
RATES = (1e-5, 5e-3)


def make_optimiser(config: PPOConfig, total_updates: int) -> optax.GradientTransformation:
    """Adam behind a clip of the gradient's norm, its rate falling linearly over the run, or following `target_kl`."""
    clip = optax.clip_by_global_norm(config.max_grad_norm)
    if config.target_kl:
        adam = optax.inject_hyperparams(optax.adam)(learning_rate=config.learning_rate, eps=1e-5)
        return optax.chain(clip, adam)
    gradient_steps = max(1, total_updates * config.epochs * config.minibatches)
    schedule = optax.linear_schedule(config.learning_rate, config.final_learning_rate, gradient_steps)
    return optax.chain(clip, optax.adam(schedule, eps=1e-5))


def follow_kl(optimiser: optax.OptState, kl: Array, progress: Array, config: PPOConfig) -> optax.OptState:
    """The state of Adam with a lower learning rate where an update changed the policy too much, a higher where little.

    The rule of Schulman et al. (2017, section 4) applied to the rate, as for legged robots (Rudin et al., CoRL 2021).
    `progress` is the share of the run that is done: the target falls with it.
    """
    target = config.target_kl * (1 - (1 - LAST_KL) * progress)
    clip, adam = optimiser
    rate = adam.hyperparams["learning_rate"]
    factor = jnp.where(kl > KL_BAND * target, 1 / RATE_STEP, jnp.where(kl < target / KL_BAND, RATE_STEP, 1.0))
    rate = jnp.clip(rate * factor, *RATES)
    return clip, adam._replace(hyperparams=adam.hyperparams | {"learning_rate": rate})


def averaged(state: TrainState, model: ActorCritic, updates: int) -> ActorCritic | None:
    """The exponential average of the parameters over so many updates, of all where there were fewer."""
    if state.average is None:
        return None
    share = 1 / jnp.minimum(state.updates + 1, updates)
    average: ActorCritic = jax.tree.map(lambda old, new: old + share * (new - old), state.average, model)
    return average


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
    going_on, reward = 1.0 - transitions.terminated, transitions.reward
    future = going_on if config.after_crash == "nothing" else jnp.ones_like(going_on)
    if transitions.cut is not None:  # the step before it is followed by its value, and from itself nothing is learned
        going_on, future = (jnp.where(transitions.cut, 0.0, share) for share in (going_on, future))
        reward = jnp.where(transitions.cut, transitions.value, reward)
    values = jnp.concatenate([transitions.value, experience.last_value[None]])
    return generalised_advantages(reward, config.gamma * future, config.gae_lambda * going_on, values)


def make_batch(experience: Experience, config: PPOConfig, axis: str | None = None) -> Batch:
    """Add advantages and value targets to the transitions."""
    advantage = advantages(experience, config)
    t = experience.transitions
    counts = None if t.counts is None else t.counts.astype(jnp.float32)
    weight = None if counts is None else counts / (mean_over_devices(counts.mean(), axis) + 1e-8)
    return Batch(
        observation=t.observation,
        action=t.action,
        noise_scale=t.noise_scale,
        in_company=t.in_company,
        log_prob=t.log_prob,
        advantage=advantage,
        value_target=advantage + t.value,
        judged=t.judged,
        begins=t.begins,
        carries=experience.carries,
        weight=weight,
    )


def _act_again(model: ActorCritic, batch: Batch) -> tuple[Float[Array, "A *B"], Float[Array, "*B"]]:
    """Mean actions and values by the present parameters: of single steps, or along sequences where there is memory."""
    if batch.begins is not None:
        assert batch.carries is not None
        return model.unroll(batch.carries, batch.observation, batch.judged, batch.begins)
    none = model.init_carries()
    _, mean, value = model.act_and_judge(none, batch.observation, batch.judged)
    return mean, value


def ppo_loss(
    model: ActorCritic, batch: Batch, config: PPOConfig, entropy_weight: Array, spread: Array | None = None
) -> tuple[Array, dict[str, Array]]:
    """Clipped surrogate + value error - entropy, over a minibatch, advantages standardised.

    Components lead; of sequences [T C E] time does. `spread` is the variance of the value targets, by default those of
    the minibatch.
    """
    spread = 1e-6 + (batch.value_target.var() if spread is None else spread)
    mean, value = _act_again(model, batch)
    action = batch.action if batch.begins is None else jnp.moveaxis(batch.action, 0, 1)
    new_log_prob = log_prob(mean, model.log_std, action, batch.noise_scale)
    log_ratio = new_log_prob - batch.log_prob
    mean_of = functools.partial(_weighted_mean, weight=batch.weight)
    policy_loss = mean_of(clipped_surrogate(jnp.exp(log_ratio), batch.advantage, config.clip_ratio))
    value_loss = mean_of(optax.l2_loss(value, batch.value_target))
    value_scale = spread if config.value_loss == "relative" else 1.0
    entropy = (model.log_std + 0.5 * jnp.log(2 * jnp.pi * jnp.e)).sum()
    loss = policy_loss + config.value_weight * 2 * value_loss / value_scale - entropy_weight * entropy
    metrics = {
        "loss/policy": policy_loss,
        "loss/value": value_loss,
        "value/explained": 1.0 - 2 * value_loss / spread,
        "policy/clipped": mean_of(jnp.abs(jnp.expm1(log_ratio)) > config.clip_ratio),
        "policy/entropy": entropy,
        "policy/kl": mean_of(jnp.expm1(log_ratio) - log_ratio),
    }
    return loss, metrics


def _weighted_mean(values: Array, weight: Array | None) -> Float[Array, ""]:
    """`weight` has a mean of 1 over the whole rollout."""
    return values.mean() if weight is None else (weight * values).mean()


def _variance(batch: Batch, axis: str | None) -> Float[Array, ""]:
    """Of the value targets on all devices of the mesh axis."""
    values = batch.value_target
    moments = _weighted_mean(values, batch.weight), _weighted_mean(values * values, batch.weight)
    mean, square = mean_over_devices(moments, axis)
    return jnp.maximum(square - mean * mean, 0.0)


def _ceiling(model: ActorCritic, max_log_std: Array) -> Float[Array, "P"]:
    """The largest value of every parameter: only the deviations have one.

    The environment clips actions, so that beyond some width more noise costs nothing, and the entropy bonus would widen
    it for ever.
    """
    unbounded = jax.tree.map(lambda leaf: jnp.full_like(leaf, jnp.inf), model)
    return flatten(eqx.tree_at(lambda m: m.log_std, unbounded, jnp.full_like(model.log_std, max_log_std)))


def make_learn(
    config: PPOConfig, optimiser: optax.GradientTransformation, total_updates: int, axis: str | None = None
) -> Callable[[TrainState, Experience, Array], tuple[TrainState, dict[str, Array]]]:
    """A function that improves the model on one rollout, given a random key for the order of the minibatches.

    `cruise.training.minibatches` says what a minibatch is. Where the races are spread over the devices of a mesh axis,
    every device holds its own and the gradients are averaged.
    """
    exploration = exploration_schedule(config, total_updates)
    widest = optax.linear_schedule(config.max_log_std, config.final_max_log_std, total_updates)

    def learn(state: TrainState, experience: Experience, shuffle_key: Array) -> tuple[TrainState, dict[str, Array]]:
        batch = make_batch(experience, config, axis)
        minibatch_of, units = make_minibatches(batch, config, axis)
        entropy_weight = exploration(state.updates)
        parameters, unflatten = ravel_pytree(state.model)
        spread = _variance(batch, axis)
        most = _ceiling(state.model, widest(state.updates))

        def loss(parameters: Array, minibatch: Batch) -> tuple[Array, dict[str, Array]]:
            return ppo_loss(unflatten(parameters), minibatch, config, entropy_weight, spread)

        def minibatch_step(carry: tuple, chosen: Array) -> tuple:
            parameters, opt_state = carry
            gradient, metrics = jax.grad(loss, has_aux=True)(parameters, minibatch_of(chosen))
            gradient = mean_over_devices(gradient, axis)
            updates, opt_state = optimiser.update(gradient, opt_state, parameters)
            parameters = jnp.minimum(optax.apply_updates(parameters, updates), most)
            return (parameters, opt_state), metrics

        def epoch(carry: tuple, epoch_key: Array) -> tuple:
            order = jax.random.permutation(epoch_key, units)
            return jax.lax.scan(minibatch_step, carry, order.reshape(config.minibatches, -1))

        keys = jax.random.split(shuffle_key, config.epochs)
        metrics: dict[str, Array]
        (parameters, opt_state), metrics = jax.lax.scan(epoch, (parameters, state.optimiser), keys)
        measured = {name: values.mean() for name, values in metrics.items()}
        if config.target_kl:
            kl = mean_over_devices(measured["policy/kl"], axis)
            opt_state = follow_kl(opt_state, kl, state.updates / total_updates, config)
            measured["policy/rate"] = opt_state[1].hyperparams["learning_rate"]
        model = unflatten(parameters)
        average = averaged(state, model, config.average_updates)
        state = state._replace(model=model, optimiser=opt_state, average=average, updates=state.updates + 1)
        return state, measured

    return learn
