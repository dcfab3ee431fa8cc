"""PPO in the manner of PureJaxRL on CRUISE's functional races: one policy learns to race against itself.

    python examples/train_jax.py

Both drones of every race fly by the policy that learns. Everything, races and learning, is one compiled program. The
loop is meant to be read and changed; `cruise train` has a curriculum, past opponents and more.
"""

import argparse
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax

import cruise

RACES, STEPS, EPOCHS, MINIBATCHES = 256, 64, 4, 16
GAMMA, LAMBDA, CLIP, ENTROPY = 0.99, 0.95, 0.2, 0.005


class Step(NamedTuple):
    """Of every drone of every race [..., L, E]."""

    seen: jax.Array
    action: jax.Array
    log_prob: jax.Array
    value: jax.Array
    next_value: jax.Array  # of what was seen at the end of the step, before a new race began
    reward: jax.Array
    terminated: jax.Array
    ended: jax.Array
    active: jax.Array  # was racing: what others did is not learned from


def layers(key, sizes, last):
    """Weights and biases, orthogonal, of a network whose arrays have components first."""
    keys, make = jax.random.split(key, len(sizes) - 1), jax.nn.initializers.orthogonal
    scales = [2**0.5] * (len(sizes) - 2) + [last]
    shapes = zip(keys, scales, sizes[:-1], sizes[1:], strict=True)
    return [(make(s)(k, (o, i)), jnp.zeros((o, 1))) for k, s, i, o in shapes]


def network(params, x):
    """[I, ...] to [O, ...]."""
    y = x.reshape(x.shape[0], -1)
    for weight, bias in params[:-1]:
        y = jnp.tanh(weight @ y + bias)
    return (params[-1][0] @ y + params[-1][1]).reshape(-1, *x.shape[1:])


def log_prob(params, seen, action):
    mean, std = network(params["actor"], seen), jnp.exp(params["log_std"])
    return jax.scipy.stats.norm.logpdf(action, mean, std.reshape(-1, *[1] * (action.ndim - 1))).sum(0)


def advantages(steps):
    """Generalised advantages; a value follows what is cut off, nothing follows a crash."""

    def back(later, step):
        error = step.reward + GAMMA * step.next_value * ~step.terminated - step.value
        later = error + GAMMA * LAMBDA * ~step.ended * later
        return later, later

    return jax.lax.scan(back, jnp.zeros_like(steps.value[0]), steps, reverse=True)[1]


def loss(params, batch):
    step, advantage, target = batch
    weight = step.active / jnp.maximum(step.active.sum(), 1)
    mean = (weight * advantage).sum()
    advantage = (advantage - mean) / jnp.sqrt((weight * (advantage - mean) ** 2).sum() + 1e-8)
    ratio = jnp.exp(log_prob(params, step.seen, step.action) - step.log_prob)
    gain = jnp.minimum(ratio * advantage, jnp.clip(ratio, 1 - CLIP, 1 + CLIP) * advantage)
    error = (network(params["critic"], step.seen)[0] - target) ** 2
    return (weight * (0.25 * error - gain)).sum() - ENTROPY * params["log_std"].sum()


def make_update(env, optimiser):
    def fly(carry, key):
        params, state, seen = carry
        mean = network(params["actor"], seen)
        white = jax.random.normal(key, mean.shape)
        action = mean + jnp.exp(params["log_std"])[:, None, None] * white
        after, state, reward, terminated, truncated, info = env.step(key, state, action)
        values = [network(params["critic"], x)[0] for x in (seen, info["final_observation"])]
        ends = (terminated, terminated | truncated, info["active"])
        step = Step(seen, action, log_prob(params, seen, action), *values, reward, *ends)
        told = (info["speed"] * info["active"], info["active"], terminated & ~info["finished"], terminated | truncated)
        return (params, state, after), (step, jax.tree.map(jnp.sum, told))

    def learn(carry, batch):
        params, moments = carry
        changes, moments = optimiser.update(jax.grad(loss)(params, batch), moments)
        return (optax.apply_updates(params, changes), moments), None

    def epoch(carry, key, flown):
        order = jax.random.permutation(key, STEPS)
        cut = lambda x: x[order].reshape(MINIBATCHES, STEPS // MINIBATCHES, *x.shape[1:])  # noqa: E731
        first = lambda x: x if x.ndim < 5 else jnp.moveaxis(x, 2, 1)  # noqa: E731  (components before steps)
        return jax.lax.scan(learn, carry, jax.tree.map(lambda x: first(cut(x)), flown))

    @jax.jit
    def update(params, moments, state, seen, key):
        fly_key, learn_key = jax.random.split(key)
        (_, state, seen), (steps, told) = jax.lax.scan(fly, (params, state, seen), jax.random.split(fly_key, STEPS))
        advantage = advantages(steps)
        flown = (steps, advantage, advantage + steps.value)
        keys = jax.random.split(learn_key, EPOCHS)
        (params, moments), _ = jax.lax.scan(lambda c, k: epoch(c, k, flown), (params, moments), keys)
        speed, flying, crashes, ends = (x.sum() for x in told)
        return params, moments, state, seen, (speed / flying, crashes / jnp.maximum(ends, 1))

    return update


def train(steps, seed=0, show=print, **race):
    """Parameters, and mean speed [m/s] and share of crashes of the last update."""
    env = cruise.make(**race)
    actor, critic, first, key = jax.random.split(jax.random.key(seed), 4)
    (inputs,), (outputs,) = env.observation_space().shape, env.action_space().shape
    params = {
        "actor": layers(actor, (inputs, 64, 64, outputs), 0.01),
        "critic": layers(critic, (inputs, 64, 64, 1), 1.0),
        "log_std": jnp.full(outputs, -0.5),
    }
    updates = max(1, steps // (RACES * STEPS * env.num_agents))
    rate = optax.linear_schedule(1.4e-3, 1e-4, updates * EPOCHS * MINIBATCHES)
    optimiser = optax.chain(optax.clip_by_global_norm(0.5), optax.adam(rate))
    update, moments = make_update(env, optimiser), optimiser.init(params)
    seen, state = env.reset(first, RACES)
    began = time.monotonic()
    for number in range(1, updates + 1):
        key, now = jax.random.split(key)
        params, moments, state, seen, (speed, crashes) = update(params, moments, state, seen, now)
        if number == updates or number % 20 == 0:
            done, seconds = number * RACES * STEPS * env.num_agents, time.monotonic() - began
            show(f"{done:>11,} steps, {seconds:4.0f} s, {float(speed):.2f} m/s, crashes {100 * float(crashes):.0f} %")
    return params, float(speed), float(crashes)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--track", default="ring")
    parser.add_argument("--drones", type=int, default=2)
    parser.add_argument("--steps", type=int, default=20_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    train(options.steps, options.seed, track=options.track, drones=options.drones)
