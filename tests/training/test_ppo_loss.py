"""PPO's loss and its gradient against the transcription of `tests.training.reference`."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import PPOConfig
from cruise.pilots.network import ActorCritic, NetworkShape
from cruise.training.experience import log_prob
from cruise.training.ppo import make_optimiser, ppo_loss
from cruise.training.types import Batch
from tests.training import reference
from tests.training.runs import random_model

CONFIG = PPOConfig(clip_ratio=0.2, value_weight=0.7)
ENTROPY_WEIGHT = 0.03
SAMPLES = 200
loss_and_gradient = jax.jit(jax.value_and_grad(ppo_loss, has_aux=True), static_argnums=2)


def a_model(seed: int = 0) -> ActorCritic:
    return random_model(seed, ActorCritic(NetworkShape(5, 3, (8, 8)), -0.5, jax.random.key(0)))


def a_batch(model: ActorCritic, seed: int = 0, drift: float = 0.3) -> Batch:
    """Samples of a policy that was a little different, so that some ratios are clipped and others not."""
    rng = np.random.default_rng(seed)
    observation = rng.normal(size=(5, SAMPLES)).astype(np.float32)
    mean = reference.mean_action(model, observation)
    noise_scale = rng.uniform(0.1, 1.0, SAMPLES)
    action = mean + np.exp(np.float64(model.log_std))[:, None] * noise_scale * rng.normal(size=mean.shape)
    old = reference.log_prob(mean, model.log_std, action, noise_scale) + drift * rng.normal(size=SAMPLES)
    advantage, target = rng.normal(2.0, 3.0, size=(2, SAMPLES))
    advantage = (advantage - advantage.mean()) / advantage.std()  # as a minibatch has them
    company = np.zeros(SAMPLES)
    columns = (observation, action, noise_scale, company, old, advantage, target)
    return Batch(*(jnp.asarray(x, jnp.float32) for x in columns))


def parameters_of(model: ActorCritic) -> dict[str, list]:
    networks = {name: reference.layers_of(getattr(model, name)) for name in ("actor", "critic")}
    return networks | {"log_std": np.float64(model.log_std)}


def transcribed(parameters: dict[str, list], batch: Batch, relative: bool = False) -> dict[str, float]:
    return reference.ppo(parameters, batch, CONFIG.clip_ratio, (CONFIG.value_weight, ENTROPY_WEIGHT), relative)


@pytest.mark.parametrize("seed", range(3))
def test_loss_and_parts_are_the_transcription(seed):
    model, batch = a_model(seed), a_batch(a_model(seed), seed)
    (loss, parts), _ = loss_and_gradient(model, batch, CONFIG, jnp.asarray(ENTROPY_WEIGHT))
    expected = transcribed(parameters_of(model), batch)
    assert float(loss) == pytest.approx(expected.pop("loss"), rel=1e-4)
    assert parts.keys() == expected.keys()
    for name, value in parts.items():
        assert float(value) == pytest.approx(expected[name], rel=1e-3, abs=1e-6), name


def test_a_relative_value_loss_is_over_the_variance_of_its_targets():
    model, config = a_model(), replace(CONFIG, value_loss="relative")
    batch = a_batch(model)._replace(value_target=jnp.float32(100 * np.random.default_rng(3).normal(size=SAMPLES)))
    loss, _ = ppo_loss(model, batch, config, jnp.asarray(ENTROPY_WEIGHT))
    assert float(loss) == pytest.approx(transcribed(parameters_of(model), batch, relative=True)["loss"], rel=1e-4)


def test_gradient_is_that_of_the_transcription():
    """Finite differences in float64 of the heads' weights and biases and of the standard deviations."""
    model = a_model()
    batch, parameters = a_batch(model), parameters_of(model)
    _, gradient = loss_and_gradient(model, batch, CONFIG, jnp.asarray(ENTROPY_WEIGHT))
    pairs = [(parameters["log_std"], gradient.log_std)]
    for name in ("actor", "critic"):
        head = getattr(gradient, name).layers[-1]
        pairs += zip(parameters[name][-1], (head.weight, head.bias), strict=True)
    for values, found in pairs:
        np.testing.assert_allclose(
            found, differences(values, lambda: transcribed(parameters, batch)["loss"]), atol=2e-5
        )


def differences(values: np.ndarray, loss, step: float = 1e-6) -> np.ndarray:
    """Central differences of `loss()` by each of `values`, which it reads."""
    result = np.zeros_like(values)
    for i in np.ndindex(*values.shape):
        original = values[i]
        ends = []
        for values[i] in (original + step, original - step):
            ends.append(loss())
        values[i] = original
        result[i] = (ends[0] - ends[1]) / (2 * step)
    return result


@pytest.mark.parametrize("good_ratio", [1.5, 0.5])
def test_no_gradient_where_clipped(good_ratio):
    """Beyond the clip on the side that the advantage points to, the policy learns nothing; on the other it does."""
    model = a_model()
    batch = a_batch(model)
    mean = reference.mean_action(model, batch.observation)
    now = reference.log_prob(mean, model.log_std, np.float64(batch.action), batch.noise_scale)
    good = np.arange(SAMPLES) % 2 == 0
    ratio = np.where(good, good_ratio, 1 / good_ratio)
    advantage = np.where(good, 1.0, -1.0)
    batch = batch._replace(log_prob=jnp.float32(now - np.log(ratio)), advantage=jnp.float32(advantage))
    _, gradient = loss_and_gradient(model, batch, CONFIG, jnp.asarray(0.0))
    policy = [*jax.tree.leaves(gradient.actor), gradient.log_std]
    largest = max(float(jnp.abs(leaf).max()) for leaf in policy)
    assert (largest == 0) if good_ratio > 1 else (largest > 1e-3)
    assert all(jnp.abs(leaf).max() > 1e-3 for leaf in jax.tree.leaves(gradient.critic))


@pytest.mark.parametrize("shape", [(3,), (3, 9), (3, 2, 9)])
def test_log_prob_is_scipys(shape):
    rng = np.random.default_rng(0)
    mean, action = rng.normal(size=(2, *shape)).astype(np.float32)
    log_std = np.float32([-2.0, 0.0, 0.7])
    noise_scale = rng.uniform(0.1, 1.0, shape[1:]).astype(np.float32)
    expected = reference.log_prob(np.float64(mean), log_std, np.float64(action), noise_scale)
    found = log_prob(*(jnp.asarray(x) for x in (mean, log_std, action, noise_scale)))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_learning_rate_falls_linearly_behind_a_clipped_gradient():
    """Under a constant gradient every step of Adam is as long as the learning rate."""
    config = PPOConfig(epochs=2, minibatches=2, learning_rate=1e-2, final_learning_rate=2e-3, max_grad_norm=0.5)
    optimiser = make_optimiser(config, total_updates=3)
    model = jnp.zeros(3)
    state = optimiser.init(model)
    for rate in np.linspace(1e-2, 2e-3, 13):
        updates, state = optimiser.update(jnp.array([100.0, -200.0, 300.0]), state, model)
        np.testing.assert_allclose(updates, rate * np.array([-1, 1, -1]), rtol=1e-3)
    first_moment = next(leaf for leaf in jax.tree.leaves(state) if leaf.shape == (3,))
    assert float(jnp.linalg.norm(first_moment)) == pytest.approx(0.5 * (1 - 0.9**13), rel=1e-3)
