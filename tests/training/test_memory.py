"""Policies with memory: a cell as Equinox has it, sequences as steps, a cue that only memory can use, nothing kept."""

import functools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import PPOConfig
from cruise.pilots.network import ActorCritic, Carries, NetworkShape, emptied
from cruise.training.experience import Experience, log_prob
from cruise.training.league import SHARES, SLOTS, found_league, opponents_fly
from cruise.training.ppo import flatten, make_batch, make_learn, make_optimiser, ppo_loss
from cruise.training.types import OpponentPool, TrainState, Transitions
from tests.training.runs import random_model

STEPS, RACES, UPDATES, LENGTH = 12, 16, 120, 4
CONFIG = PPOConfig(
    races=RACES,
    rollout_steps=STEPS,
    minibatches=4,
    learning_rate=1e-2,
    final_learning_rate=2e-3,
    gamma=0.9,
    after_crash="nothing",
    network="gru",
    memory_size=8,
    hidden=(8,),
)


def model_of(kind: str = "gru", observation: int = 2, critic: int = 0, seed: int = 0) -> ActorCritic:
    memory = 8 if kind == "gru" else 0
    return ActorCritic(NetworkShape(observation, 1, (8,), kind, memory, critic), -0.5, jax.random.key(seed))


def loud(seed: int = 0, **shape: int) -> ActorCritic:
    return random_model(seed, model_of(**shape), 0.7)


def sequence(seed: int, steps: int = 9, races: int = 5, size: int = 2) -> tuple[jax.Array, jax.Array]:
    """Observations [T, O, E] and where episodes begin."""
    rng = np.random.default_rng(seed)
    seen, begins = rng.normal(size=(steps, size, races)), rng.random((steps, races)) < 0.3
    return jnp.asarray(seen, jnp.float32), jnp.asarray(begins)


def test_a_step_is_equinoxs_cell_and_the_head_behind_it():
    """For every drone of every race by itself."""
    model, rng = loud(), np.random.default_rng(0)
    carry, seen = (jnp.asarray(rng.normal(size=(size, 3, 4)), jnp.float32) for size in (8, 2))
    after, mean = model.apply(carry, seen)
    for drone, race in np.ndindex(3, 4):
        state = model.actor.cell(seen[:, drone, race], carry[:, drone, race])
        np.testing.assert_allclose(after[:, drone, race], state, atol=1e-6)
        np.testing.assert_allclose(mean[:, drone, race], model.actor.head(state), atol=1e-6)
        one, alone = model.apply(carry[:, drone, race], seen[:, drone, race])
        np.testing.assert_allclose(one, after[:, drone, race], atol=1e-6)
        np.testing.assert_allclose(alone, mean[:, drone, race], atol=1e-6)


def test_a_sequence_is_one_step_after_the_other():
    model, (seen, begins) = loud(critic=3), sequence(1)
    judged, _ = sequence(2, size=3)
    carries = jax.tree.map(lambda leaf: leaf + 0.5, model.init_carries((5,)))
    mean, value = model.unroll(carries, seen, judged, begins)
    for t in range(len(seen)):
        carries, action, worth = model.act_and_judge(emptied(carries, begins[t]), seen[t], judged[t])
        np.testing.assert_allclose(mean[:, t], action, atol=1e-5)
        np.testing.assert_allclose(value[t], worth, atol=1e-5)


def test_a_new_episode_knows_nothing_of_the_old():
    """From the step on at which it begins, whatever was remembered or seen before."""
    model, (seen, begins) = loud(), sequence(3)
    begins = begins.at[4].set(True)
    other = seen.at[:4].set(7.0)
    for carries in (model.init_carries((5,)), jax.tree.map(lambda leaf: leaf + 1, model.init_carries((5,)))):
        mean, value = model.unroll(carries, other, None, begins)
        as_before = model.unroll(model.init_carries((5,)), seen, None, begins)
        np.testing.assert_array_equal(mean[:, 4:], as_before[0][:, 4:])
        np.testing.assert_array_equal(value[4:], as_before[1][4:])
        assert np.abs(mean[:, :4] - as_before[0][:, :4]).max() > 0.01


def test_a_perceptron_remembers_nothing_at_no_cost():
    model, (seen, begins) = loud(kind="mlp"), sequence(4)
    assert jax.tree.leaves(model.init_carries((5,))) == []
    assert model.init_carry((5,)) == ()
    mean, value = model.unroll(model.init_carries((5,)), seen, None, begins)
    np.testing.assert_allclose(mean, model.mean_action(jnp.moveaxis(seen, 0, 1)), atol=1e-6)
    np.testing.assert_allclose(value, model.value(jnp.moveaxis(seen, 0, 1)), atol=1e-6)
    text = str(jax.make_jaxpr(model.apply)((), seen[0]))
    assert text == str(jax.make_jaxpr(lambda carry, x: (carry, model.mean_action(x)))((), seen[0]))


def test_opponents_keep_their_memories_apart():
    """Newest, previous and members of the league: each race is flown by one, from what that one remembers there."""
    newest, previous, *members = (loud(seed) for seed in range(6))
    rng = np.random.default_rng(5)
    league = found_league(newest, 4, members)._replace(flying=jnp.array([2, 0, 3, 1]))
    older = jnp.asarray(rng.random(2 * SHARES) < 0.5)
    pool = OpponentPool(newest, previous, older, jnp.zeros((), jnp.int32))
    carry, seen = (jnp.asarray(rng.normal(size=(size, 3, 2 * SHARES)), jnp.float32) for size in (8, 2))
    remembered, action = opponents_fly(pool, league, carry, seen)
    for race in range(2 * SHARES):
        share = race % SHARES
        model = (previous if older[race] else newest) if share < SLOTS else members[int(league.flying[share - SLOTS])]
        expected = model.apply(carry[..., race], seen[..., race])
        np.testing.assert_allclose(remembered[..., race], expected[0], atol=1e-5)
        np.testing.assert_allclose(action[..., race], expected[1], atol=1e-5)


def cues(key: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Observations [T, 2, E] and cues [T, E]: one at the start of every episode, and a bell where it is asked for."""
    episodes = STEPS // LENGTH
    cue = jnp.repeat(jax.random.rademacher(key, (episodes, RACES), jnp.float32), LENGTH, axis=0)
    moment = jnp.arange(STEPS)[:, None] % LENGTH
    shown, bell = jnp.where(moment == 0, cue, 0.0), jnp.broadcast_to(moment == LENGTH - 1, cue.shape)
    return jnp.stack([shown, bell.astype(jnp.float32)], axis=1), cue


def live(model: ActorCritic, key: jax.Array) -> tuple[Experience, jax.Array]:
    """A rollout of the game of cues, and how far off the answers would have been without noise."""
    cue_key, noise_key = jax.random.split(key)
    seen, cue = cues(cue_key)
    moment = jnp.broadcast_to(jnp.arange(STEPS)[:, None] % LENGTH, cue.shape)
    begins, ended = moment == 0, moment == LENGTH - 1
    carries = model.init_carries((RACES,))
    mean, value = model.unroll(carries, seen, None, begins)
    action = mean + jnp.exp(model.log_std)[:, None, None] * jax.random.normal(noise_key, mean.shape)
    reward = jnp.where(ended, -((action[0] - cue) ** 2), 0.0)
    transitions = Transitions(
        observation=seen,
        action=jnp.moveaxis(action, 0, 1),
        noise_scale=jnp.ones_like(value),
        in_company=jnp.zeros(value.shape, bool),
        log_prob=log_prob(mean, model.log_std, action),
        value=value,
        reward=reward,
        terminated=ended,
        begins=begins if model.has_memory else None,
    )
    missed = jnp.where(ended, jnp.abs(mean[0] - cue), 0.0).sum() / ended.sum()
    return Experience(transitions, jnp.zeros(RACES), {}, carries if model.has_memory else None), missed


@functools.cache
def learned(kind: str) -> float:
    """How far off the answers are after a whole run."""
    config = replace(CONFIG, network=kind)
    model, optimiser = model_of(kind), make_optimiser(config, UPDATES)
    learn = make_learn(config, optimiser, UPDATES)
    state = TrainState(
        model, optimiser.init(flatten(model)), None, None, None, None, jax.random.key(0), jnp.asarray(0, jnp.int32)
    )

    def update(state: TrainState, key: jax.Array) -> tuple[TrainState, jax.Array]:
        lived, shuffle = jax.random.split(key)
        experience, missed = live(state.model, lived)
        return learn(state, experience, shuffle)[0], missed

    keys = jax.random.split(jax.random.key(1), UPDATES)
    _, missed = jax.jit(lambda state: jax.lax.scan(update, state, keys))(state)
    return float(missed[-5:].mean())


def test_a_cue_is_remembered_by_who_has_a_memory():
    """Each answer is +-1, shown three steps before it is asked for: without memory 0 is the best guess, off by 1."""
    assert learned("gru") < 0.2
    assert learned("mlp") > 0.8


def test_a_minibatch_of_sequences_has_the_gradient_of_its_steps():
    """Along one direction of the parameters: the loss over sequences against the same loss step by step."""
    model = loud(3)
    experience, _ = live(loud(4), jax.random.key(2))
    batch = make_batch(experience, CONFIG)

    def by_steps(scale: jax.Array) -> jax.Array:
        changed = jax.tree.map(lambda leaf: leaf * scale, model)
        carries, rows = batch.carries, []
        for t in range(STEPS):
            carries, *row = changed.act_and_judge(emptied(carries, batch.begins[t]), batch.observation[t])
            rows.append(row)
        mean, value = jnp.stack([row[0] for row in rows], 1), jnp.stack([row[1] for row in rows])
        ratio = jnp.exp(log_prob(mean, changed.log_std, jnp.moveaxis(batch.action, 0, 1)) - batch.log_prob)
        surrogate = jnp.minimum(ratio * batch.advantage, jnp.clip(ratio, 0.8, 1.2) * batch.advantage)
        entropy = (changed.log_std + 0.5 * jnp.log(2 * jnp.pi * jnp.e)).sum()
        return -surrogate.mean() + 0.5 * ((value - batch.value_target) ** 2).mean() - 0.01 * entropy

    def whole(scale: jax.Array) -> jax.Array:
        return ppo_loss(jax.tree.map(lambda leaf: leaf * scale, model), batch, CONFIG, jnp.float32(0.01))[0]

    expected, found = (jax.jit(jax.value_and_grad(loss))(jnp.float32(1.0)) for loss in (by_steps, whole))
    assert float(found[0]) == pytest.approx(float(expected[0]), rel=1e-4)
    assert float(found[1]) == pytest.approx(float(expected[1]), rel=1e-3)
    assert isinstance(batch.carries, Carries)
