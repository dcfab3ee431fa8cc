"""How far an update goes, and what is kept of many: a learning rate that follows the KL divergence, averages."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.storage.checkpoint import load_checkpoint, save_checkpoint
from cruise.training.ppo import KL_BAND, LAST_KL, RATE_STEP, RATES, follow_kl, make_learn, make_optimiser
from tests.training import test_learn
from tests.training.runs import bits, whole_run
from tests.training.test_learn import CONFIG, UPDATES, beginner, live, one_step

FOLLOWS = replace(CONFIG, target_kl=0.01, learning_rate=1e-3)
TARGETS = {0.0: 0.01, 1.0: LAST_KL * 0.01}  # by the share of the run that is done


@pytest.mark.parametrize("progress", TARGETS)
@pytest.mark.parametrize(
    ("kl", "factor"), [(0.9 / KL_BAND, RATE_STEP), (1.0, 1.0), (1.1 * KL_BAND, 1 / RATE_STEP)], ids=str
)
def test_the_rate_rises_after_small_changes_and_falls_after_large_ones(progress, kl, factor):
    state = make_optimiser(FOLLOWS, UPDATES).init(jnp.zeros(3))
    after = follow_kl(state, jnp.float32(kl * TARGETS[progress]), jnp.float32(progress), FOLLOWS)
    assert float(after[1].hyperparams["learning_rate"]) == pytest.approx(1e-3 * factor)


@pytest.mark.parametrize(("kl", "bound"), [(0.0, RATES[1]), (1.0, RATES[0])])
def test_the_rate_stays_within_bounds(kl, bound):
    state = make_optimiser(FOLLOWS, UPDATES).init(jnp.zeros(3))
    for _ in range(40):
        state = follow_kl(state, jnp.float32(kl), jnp.float32(0.5), FOLLOWS)
    assert float(state[1].hyperparams["learning_rate"]) == pytest.approx(bound)


@pytest.mark.parametrize("rate", [3e-5, 5e-3])
def test_whatever_the_rate_at_the_start_updates_change_the_policy_by_the_target(rate):
    config = replace(FOLLOWS, learning_rate=rate)
    optimiser = make_optimiser(config, 10**6)
    learn = make_learn(config, optimiser, 10**6)

    @jax.jit
    def update(state, problem):
        noise_key, shuffle_key = jax.random.split(jax.random.fold_in(state.key, state.updates))
        return learn(state, live(state.model, problem, noise_key), shuffle_key)

    problem = jax.tree.map(jnp.float32, one_step(cost=0.1, target=0.3, luck=1.0))
    state = beginner()
    state = state._replace(optimiser=optimiser.init(test_learn.flatten(state.model)))
    changes = []
    for _ in range(UPDATES):
        state, metrics = update(state, problem)
        changes.append(float(metrics["policy/kl"]))
    assert config.target_kl / 2 < np.median(changes[UPDATES // 2 :]) < config.target_kl * 2


def test_the_average_is_of_the_last_updates_and_changes_nothing_else():
    config = replace(CONFIG, average_updates=4)
    problem = jax.tree.map(jnp.float32, one_step(cost=1.0, target=0.6))
    plain, state = beginner(), beginner()
    state = state._replace(average=state.model)
    expected = [np.asarray(leaf) for leaf in jax.tree.leaves(state.model)]
    for number in range(1, 8):
        plain, state = test_learn.learner()(plain, problem), test_learn.learner(config)(state, problem)
        share = 1 / min(number, 4)
        newest = [np.asarray(leaf) for leaf in jax.tree.leaves(state.model)]
        expected = [old + share * (new - old) for old, new in zip(expected, newest, strict=True)]
        for found, leaf in zip(jax.tree.leaves(state.policy), expected, strict=True):
            np.testing.assert_allclose(found, leaf, rtol=1e-5, atol=1e-6)
    assert bits(state.model) == bits(plain.model)
    assert plain.policy is plain.model


def test_the_average_races_as_the_opponent():
    """An opponent is what was measured; the newest parameters never fly against themselves."""
    replaced = [progress.state for progress in whole_run() if progress.opponents_replaced]
    assert replaced
    for state in replaced:
        assert bits(state.opponents.newest) == bits(state.average) != bits(state.model)


def test_a_checkpoint_keeps_the_rate_that_was_reached(tmp_path):
    optimiser = make_optimiser(FOLLOWS, UPDATES)
    state = follow_kl(optimiser.init(jnp.zeros(3)), jnp.float32(1.0), jnp.float32(0.0), FOLLOWS)
    save_checkpoint(tmp_path, {"optimiser": state}, {})
    loaded, _ = load_checkpoint(tmp_path, {"optimiser": jax.eval_shape(optimiser.init, jnp.zeros(3))})
    assert bits(loaded["optimiser"]) == bits(state) != bits(optimiser.init(jnp.zeros(3)))
