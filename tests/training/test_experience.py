"""Rollouts against the same rollouts flown step by step; restarts, time limits, opponents that stay away."""

import functools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.env.race_env import make_race_env
from cruise.presets import TRACKS, VEHICLES
from cruise.training.experience import (
    begin_again,
    draw,
    hide_opponents,
    make_collect,
    or_from_here,
    thin_out,
)
from cruise.training.league import newest_fly
from cruise.training.types import OpponentPool, TrainState
from tests.training import reference
from tests.training.replay import Replayed, replay
from tests.training.runs import RACES, STEPS, TINY, last_rules, moving, random_model, tiny_trainer


def busy_state(alone: bool) -> TrainState:
    """Everything that can be under way: thrown drones, three different policies, races about to begin anew."""
    rng = np.random.default_rng(7)
    state = tiny_trainer().initial_state()
    model, newest, previous = (random_model(seed, state.model) for seed in range(3))
    mixed, restart = (jnp.asarray(rng.random(RACES) < share) for share in (0.6, 0.2))
    pool = OpponentPool(newest, previous, mixed, jnp.asarray(0, jnp.int32))
    races = hide_opponents(moving(state.races, 0), jnp.asarray(alone))
    return state._replace(model=model, opponents=pool, races=races, restart=restart)


@functools.cache
def collector():
    return jax.jit(make_collect(tiny_trainer().env, TINY))


@functools.cache
def drawer():
    return jax.jit(functools.partial(draw, tiny_trainer().env, config=TINY))


@functools.cache
def two_rollouts(alone: bool) -> list[tuple]:
    """(state before, state after, experience, the same flown again), the second from where the first ended."""
    state, rules, result = busy_state(alone), last_rules(), []
    for number in range(2):
        draws = drawer()(jax.random.key(number))
        after, experience = collector()(state, draws, rules, jnp.asarray(alone))
        again = replay(state, draws.start, rules, alone, np.asarray(experience.transitions.action))
        result.append((state, after, experience, again))
        state = after
    return result


def in_both(alone: bool):
    return two_rollouts(alone)[0], two_rollouts(alone)[1]


@pytest.mark.parametrize("alone", [False, True])
def test_a_rollout_is_what_the_environment_says(alone):
    for _, after, experience, again in in_both(alone):
        for name, expected in again.transitions.items():
            found = getattr(experience.transitions, name)
            assert found.shape == expected.shape
            np.testing.assert_allclose(found, expected, atol=2e-3, err_msg=name)
        np.testing.assert_allclose(experience.last_value, again.last_value, atol=2e-3)
        for found, expected in zip(jax.tree.leaves(after.races), jax.tree.leaves(again.races), strict=True):
            np.testing.assert_allclose(found, expected, atol=2e-3)
        assert again.transitions["terminated"].any()
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((experience.transitions, experience.metrics)))
    assert 20 < in_both(alone)[0][3].transitions["terminated"].sum() < STEPS * RACES / 4


@pytest.mark.parametrize("alone", [False, True])
def test_a_race_begins_anew_after_a_crash_and_at_the_time_limit(alone):
    for before, after, experience, again in in_both(alone):
        crashed = np.asarray(experience.transitions.terminated)
        np.testing.assert_array_equal(again.restarted[0], before.restart)
        np.testing.assert_array_equal(again.restarted[1:], crashed[:-1])
        age = np.asarray(after.races.step)
        overdue = ~crashed[-1] & (age >= TINY.episode_steps)
        assert overdue.any()
        np.testing.assert_array_equal(after.restart, crashed[-1] | overdue)
        assert float(experience.metrics["truncated"]) == pytest.approx(overdue.mean() / STEPS)
    assert np.asarray(after.races.step).max() >= TINY.episode_steps  # it is looked at only when a rollout ends


def age_at_the_end(again: Replayed) -> np.ndarray:
    """Steps since the last restart of those races that restarted in the rollout; -1 elsewhere."""
    last = STEPS - 1 - again.restarted[::-1].argmax(0)
    return np.where(again.restarted.any(0), STEPS - last, -1)


@pytest.mark.parametrize("alone", [False, True])
def test_a_new_race_starts_at_rest_with_its_clock_at_zero(alone):
    for _, after, experience, again in in_both(alone):
        expected = age_at_the_end(again)
        begun = expected >= 0
        assert begun.any()
        assert not begun.all()
        np.testing.assert_array_equal(np.asarray(after.races.step)[begun], expected[begun])
        observation = np.asarray(experience.transitions.observation)
        velocity = observation[:, 12:15]  # after the place (3), the distance (1), two legs (6) and a normal (2)
        assert (np.moveaxis(velocity, 1, -1)[again.restarted] == 0).all()


def test_opponents_change_with_the_race_and_not_before():
    """A race under way is flown to its end by the generation it began with; a new race has the newest."""
    older = busy_state(False).opponents.uses_previous
    for before, after, _, again in in_both(False):
        np.testing.assert_array_equal(before.opponents.uses_previous, older)
        older = np.asarray(older) & ~again.restarted.any(0)
        np.testing.assert_array_equal(after.opponents.uses_previous, older)
        assert 0 < older.sum() < RACES
    # The replay above flies each race by its own generation; by the other one, its opponents would be elsewhere.
    before, after, experience, again = two_rollouts(False)[0]
    pool = before.opponents
    swapped = before._replace(opponents=pool._replace(newest=pool.previous, previous=pool.newest))
    starts = drawer()(jax.random.key(0)).start
    other = replay(swapped, starts, last_rules(), False, np.asarray(experience.transitions.action))
    place, elsewhere = (r.drones.body.position_w[:, 1] for r in (after.races, other.races))
    apart = np.abs(np.asarray(place) - elsewhere).max(0) > 0.01
    by_hand = np.asarray(before.sparring.speed[1]) > 0
    assert apart[~by_hand].mean() > 0.9
    assert not apart[by_hand & ~again.restarted.any(0)].any()


def test_actions_are_the_mean_and_white_noise_narrower_beside_an_opponent():
    noise = []
    for before, _, experience, again in in_both(False):
        observation, action = (np.asarray(x) for x in experience.transitions[:2])
        scales = again.transitions["noise_scale"]
        assert TINY.ppo.least_noise <= scales.min() < 0.9
        for seen, flown, scale in zip(observation, action, scales, strict=True):
            std = np.exp(np.float64(before.model.log_std))[:, None] * scale
            noise.append((flown - reference.mean_action(before.model, seen)) / std)
        assert 0.02 < again.transitions["in_company"].mean() < 0.98
    assert (two_rollouts(True)[0][3].transitions["noise_scale"] == 1).all()
    assert not two_rollouts(True)[0][3].transitions["in_company"].any()
    noise = np.array(noise)
    assert abs(noise.mean()) < 0.05
    assert noise.std() == pytest.approx(1.0, abs=0.05)
    flat = noise.transpose(1, 0, 2).reshape(3, -1)
    assert (np.abs(np.corrcoef(flat) - np.eye(3)) < 0.1).all()
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.05


def test_metrics_are_means_of_the_rollout():
    for _, _, experience, _ in in_both(False):
        metrics, lived = experience.metrics, experience.transitions
        assert float(metrics["reward"]) == pytest.approx(float(lived.reward.mean()), abs=1e-5)
        assert float(metrics["terminated"]) == pytest.approx(float(lived.terminated.mean()), abs=1e-6)
        assert 0 < float(metrics["speed"]) < 15
        kinds = [float(value) for name, value in metrics.items() if name.startswith("collision/")]
        assert max(kinds) <= float(metrics["terminated"]) <= sum(kinds) + 1e-6


def test_alone_means_that_opponents_are_neither_seen_nor_met():
    trainer = tiny_trainer()
    for _, after, experience, _ in in_both(True):
        assert np.asarray(after.races.out[1:]).all()
        seen = np.asarray(experience.transitions.observation)
        assert (seen[:, -9:] == 0).all()
        assert float(experience.metrics["collision/drone"]) == 0
    shared = hide_opponents(trainer.initial_state().races, jnp.asarray(False))
    assert not np.asarray(shared.out).any()
    seen = np.asarray(two_rollouts(False)[0][2].transitions.observation)
    assert (seen[:, -9:] != 0).any(axis=1).mean() > 0.5


def test_a_thinned_out_field_has_every_number_of_opponents_as_often():
    env = make_race_env(TRACKS["ring"], 4, VEHICLES["racer"], "body")
    races = env.reset(jax.random.key(0), (4000,))
    out = np.asarray(thin_out(races, jax.random.key(1)).out)
    assert not out[0].any()
    np.testing.assert_allclose(np.bincount(3 - out.sum(axis=0), minlength=4) / 4000, 0.25, atol=0.03)
    opponents = [replace(TINY.opponents, vary_field=vary) for vary in (False, True)]
    full, varied = (draw(env, jax.random.key(2), replace(TINY, opponents=which)).start for which in opponents)
    assert not np.asarray(full.out).any()
    assert np.asarray(varied.out).any()
    np.testing.assert_array_equal(full.drones.position_w, varied.drones.position_w)


def test_a_race_that_crashed_is_tried_again_from_where_the_rollout_began():
    """Unless it was to begin anew there."""
    state, start = busy_state(False), drawer()(jax.random.key(0)).start
    retry = jnp.arange(RACES) % 2 == 0
    chosen = or_from_here(start, state, retry)
    here = np.asarray(retry & ~state.restart)
    assert 0 < here.sum() < RACES / 2
    for found, now, fresh in zip(*(jax.tree.leaves(tree) for tree in (chosen, state.races, start)), strict=True):
        np.testing.assert_array_equal(found, np.where(here, now, fresh))


def test_begin_again_takes_the_new_start_where_asked():
    races = tiny_trainer().initial_state().races
    start = jax.tree.map(lambda x: x + 1 if x.dtype != bool else ~x, races)
    restart = jnp.arange(RACES) % 3 == 0
    mixed = begin_again(races, start, restart)
    for old, new, found in zip(*(jax.tree.leaves(tree) for tree in (races, start, mixed)), strict=True):
        np.testing.assert_array_equal(found, np.where(restart, new, old))


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_each_race_is_flown_by_its_own_generation(share):
    """Three opponents a race, any number of races on the older policy."""
    rng = np.random.default_rng(0)
    like = tiny_trainer().initial_state().model
    newest, previous = random_model(1, like), random_model(2, like)
    older = rng.random(10) < share
    observation = jnp.asarray(rng.normal(size=(like.actor.layers[0].in_features, 3, 10)), jnp.float32)
    pool = OpponentPool(newest, previous, jnp.asarray(older), jnp.asarray(0, jnp.int32))
    _, found = newest_fly(pool, (), observation)
    for k in range(3):
        own, its = (reference.mean_action(model, observation[:, k]) for model in (newest, previous))
        np.testing.assert_allclose(found[:, k], np.where(older, its, own), atol=1e-4)
