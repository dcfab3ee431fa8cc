"""Networks, advantages and PPO's loss written again in plain NumPy, float64, from the papers."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from cruise.config import PPOConfig
from cruise.pilots.network import ActorCritic, Perceptron
from cruise.training.types import Batch

Layers = list[tuple[np.ndarray, np.ndarray]]


def layers_of(network: Perceptron) -> Layers:
    """Weights and biases."""
    return [(np.float64(layer.weight), np.float64(layer.bias)) for layer in network.layers]


def perceptron(layers: Layers, x: np.ndarray) -> np.ndarray:
    """Outputs [O, B] of inputs [I, B]: tanh between the layers."""
    for i, (weight, bias) in enumerate(layers):
        x = weight @ x + bias[:, None]
        x = np.tanh(x) if i < len(layers) - 1 else x
    return x


def mean_action(model: ActorCritic, observation: np.ndarray) -> np.ndarray:
    """[A, B] of [O, B]."""
    return perceptron(layers_of(model.actor), np.float64(observation))


def value(model: ActorCritic, observation: np.ndarray) -> np.ndarray:
    """[B] of [O, B]."""
    return perceptron(layers_of(model.critic), np.float64(observation))[0]


def log_prob(mean: np.ndarray, log_std: np.ndarray, action: np.ndarray, noise_scale=1.0) -> np.ndarray:
    """[B] of [A, B], by SciPy; `noise_scale` [B] times the deviations."""
    rows = zip(mean, np.float64(log_std), action, strict=True)
    return sum(norm(m, np.exp(s) * np.float64(noise_scale)).logpdf(a) for m, s, a in rows)


def advantages(
    reward: Sequence[float], values: Sequence[float], terminated: Sequence[bool], last_value: float, config: PPOConfig
) -> np.ndarray:
    """GAE of one race: A_t = delta_t + gamma lambda A_{t+1}, `last_value` beyond the end.

    After a crash no more than the value of the new start, which stands in the next place, or nothing at all.
    """
    gamma, lam = config.gamma, config.gae_lambda
    result = np.zeros(len(reward))
    following, following_value = 0.0, float(last_value)
    for t in reversed(range(len(reward))):
        if terminated[t]:
            following = 0.0
            following_value *= config.after_crash == "restart"
        delta = float(reward[t]) + gamma * following_value - float(values[t])
        following = delta + gamma * lam * following
        result[t] = following
        following_value = float(values[t])
    return result


def ppo(
    parameters: dict[str, list], batch: Batch, clip: float, weights: tuple[float, float], relative: bool = False
) -> dict[str, float]:
    """Total loss and its parts. `parameters`: actor and critic layers, log_std; `weights`: of value and entropy."""
    observation, action, noise_scale, _, old, advantage, target = (np.float64(x) for x in batch[:7])
    log_std = np.asarray(parameters["log_std"])
    new = log_prob(perceptron(parameters["actor"], observation), log_std, action, noise_scale)
    ratio = np.exp(new - old)
    advantage = (advantage - advantage.mean()) / advantage.std()
    surrogate = np.minimum(ratio * advantage, np.clip(ratio, 1 - clip, 1 + clip) * advantage)
    parts = {
        "loss/policy": -surrogate.mean(),
        "loss/value": 0.5 * np.mean((perceptron(parameters["critic"], observation)[0] - target) ** 2),
        "policy/entropy": sum(norm(scale=np.exp(s)).entropy() for s in log_std),
        "policy/kl": np.mean(ratio - 1 - np.log(ratio)),
        "policy/clipped": np.mean(abs(ratio - 1) > clip),
    }
    parts["value/explained"] = 1 - 2 * parts["loss/value"] / target.var()
    value_loss = parts["loss/value"] / (target.var() if relative else 1)
    total = parts["loss/policy"] + weights[0] * 2 * value_loss - weights[1] * parts["policy/entropy"]
    return parts | {"loss": total}
