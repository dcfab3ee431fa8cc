"""Races in which every drone learns: what is learned from, what is not, and that nothing else is counted."""

import functools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.pilots.scripted import Chaser
from cruise.presets import TRACKS, VEHICLES
from cruise.training.experience import Experience, draw, ends_race, make_collect
from cruise.training.minibatches import make_minibatches
from cruise.training.ppo import advantages, make_batch, ppo_loss
from cruise.training.trainer import Trainer
from cruise.training.types import TrainState, Transitions
from cruise.training.validation import check_config
from tests.training import reference
from tests.training.replay import numpy_copy
from tests.training.runs import ALL_LEARN, RACES, STEPS, TINY, last_rules, moving, random_model

DRONES = ALL_LEARN.drones


@functools.cache
def trainer() -> Trainer:
    return Trainer(ALL_LEARN, TRACKS["ring"], VEHICLES["paper"])


@functools.cache
def rollout() -> tuple[TrainState, TrainState, Experience]:
    """(before, after, what was lived through): thrown drones, by a policy that crashes."""
    state = trainer().initial_state()
    state = state._replace(model=random_model(3, state.model), races=moving(state.races, 1))
    draws = draw(trainer().env, jax.random.key(5), ALL_LEARN)
    after, experience = jax.jit(make_collect(trainer().env, ALL_LEARN))(state, draws, last_rules(), jnp.asarray(False))
    return state, after, experience


def by_drone(rows) -> np.ndarray:
    """[T, N, E] of [T, NE]."""
    rows = np.asarray(rows)
    return rows.reshape(*rows.shape[:-1], DRONES, RACES)


def test_a_rollout_is_what_the_environment_says_of_every_drone():
    """Flown again step by step: what counts was flown by the policy, by a drone in the air, in a race that went on."""
    before, after, experience = rollout()
    env, lived, rules = trainer().env, experience.transitions, last_rules()
    step, observe = jax.jit(env.step), jax.jit(env.observe)
    races, restart = numpy_copy(before.races), np.array(before.restart)
    starts = numpy_copy(draw(env, jax.random.key(5), ALL_LEARN).start)
    by_hand = np.asarray(before.sparring.speed) > 0
    assert by_hand.any()
    sparred = jax.jit(functools.partial(_chasers, env))
    for t in range(STEPS):
        for now, start in zip(jax.tree.leaves(races), jax.tree.leaves(starts), strict=True):
            now[..., restart] = start[..., restart]
        races = jax.tree.map(jnp.asarray, races)
        flying = np.asarray(races.airborne)
        seen = by_drone(lived.observation)[t]
        np.testing.assert_allclose(np.asarray(observe(races)), seen, atol=2e-3)
        flown = np.array(env.decode(races, jnp.asarray(by_drone(lived.action)[t])))
        flown[:, by_hand] = np.asarray(sparred(races, before.sparring, rules.agility))[:, by_hand]
        races, outcome = step(races, jnp.asarray(flown), rules)
        crashed = np.asarray(outcome.terminated)
        restart = crashed[0]  # one of three: half, rounded down
        np.testing.assert_array_equal(by_drone(lived.terminated)[t], crashed)
        np.testing.assert_allclose(by_drone(lived.reward)[t], np.asarray(outcome.reward), atol=2e-3)
        np.testing.assert_array_equal(by_drone(lived.cut)[t], restart & ~crashed)
        np.testing.assert_array_equal(by_drone(lived.counts)[t], flying & ~by_hand & ~(restart & ~crashed))
        races = numpy_copy(races)
    for found, expected in zip(jax.tree.leaves(after.races), jax.tree.leaves(races), strict=True):
        np.testing.assert_allclose(found, expected, atol=2e-3)
    counts, cut = by_drone(lived.counts), by_drone(lived.cut)
    assert counts[:, 0].mean() == 1 - cut[:, 0].mean() == 1.0  # who ends a race by a crash always flies
    assert 0.2 < counts[:, 1:].mean() < 0.8
    assert cut.any()


def _chasers(env, races, sparring, agility):
    return Chaser().command(env, races, sparring.speed, sparring.push, agility)


def test_who_ends_a_race():
    crashed = jnp.asarray(np.eye(5, dtype=bool))
    assert [bool(x) for x in ends_race(crashed[:1])] == [True, False, False, False, False]
    assert [bool(x) for x in ends_race(crashed)] == [True, True, False, False, False]


def made_up(after_crash: str) -> tuple[Experience, Transitions]:
    """One drone of one race: nothing special in it but a cut at step 5 and a crash at step 9."""
    rng = np.random.default_rng(0)
    row = lambda: jnp.asarray(rng.normal(size=(14, 1)), jnp.float32)  # noqa: E731
    when = lambda step: jnp.asarray(np.arange(14)[:, None] == step)  # noqa: E731
    nothing = jnp.zeros((14, 1, 1))
    lived = Transitions(nothing, nothing, row(), when(-1), row(), row(), row(), when(9), counts=~when(5), cut=when(5))
    return Experience(lived, jnp.asarray([0.3], jnp.float32), {}), lived


@pytest.mark.parametrize("after_crash", ["restart", "nothing"])
def test_a_race_that_another_ended_is_as_if_the_rollout_had_ended_there(after_crash):
    experience, lived = made_up(after_crash)
    config = replace(ALL_LEARN.ppo, after_crash=after_crash)
    reward, value, crashed = (np.asarray(x)[:, 0] for x in (lived.reward, lived.value, lived.terminated))
    first = reference.advantages(reward[:5], value[:5], crashed[:5], value[5], config)
    second = reference.advantages(reward[6:], value[6:], crashed[6:], 0.3, config)
    np.testing.assert_allclose(advantages(experience, config)[:, 0], [*first, 0.0, *second], rtol=1e-5, atol=1e-6)


def spoiled(experience: Experience) -> Experience:
    """The same with other numbers where nothing is learned from."""
    lived = experience.transitions
    ignored = ~lived.counts & ~lived.cut
    strange = {"observation": 7.0, "action": 0.5, "log_prob": -1.0, "reward": 9.0, "noise_scale": 0.9}
    changed = {}
    for name, number in strange.items():
        rows = getattr(lived, name)
        changed[name] = jnp.where(ignored if rows.ndim == 2 else ignored[:, None], number, rows)
    return experience._replace(transitions=lived._replace(**changed))


@pytest.mark.parametrize("company", [0.0, 3.0])
def test_nothing_is_learned_from_who_does_not_fly(company):
    """Loss, its gradient and what is logged are those of the steps that count, whatever stands in the others."""
    before, _, experience = rollout()
    config = replace(ALL_LEARN.ppo, company_distance=company)
    found = []
    for lived in (experience, spoiled(experience)):
        batch = make_batch(lived, config)
        minibatch_of, units = make_minibatches(batch, config, None)
        picked = minibatch_of(jnp.arange(units))
        found.append(jax.grad(ppo_loss, has_aux=True)(before.model, picked, config, jnp.float32(0.01), jnp.float32(2)))
    for one, other in zip(jax.tree.leaves(found[0]), jax.tree.leaves(found[1]), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)


def test_the_loss_is_that_of_the_steps_that_count():
    before, _, experience = rollout()
    config = replace(ALL_LEARN.ppo, company_distance=0.0)
    batch = make_batch(experience, config)
    minibatch_of, units = make_minibatches(batch, config, None)
    picked = minibatch_of(jnp.arange(units))
    model = random_model(4, before.model)
    _, found = ppo_loss(model, picked, config, jnp.float32(0.01), jnp.float32(2))
    counts = np.asarray(picked.weight) > 0
    only = jax.tree.map(lambda leaf: np.asarray(leaf)[..., counts], picked)
    layers = {"actor": reference.layers_of(model.actor), "critic": reference.layers_of(model.critic)}
    wanted = reference.ppo(layers | {"log_std": model.log_std}, only, config.clip_ratio, (0.5, 0.01))
    for name in ("loss/policy", "loss/value", "policy/kl", "policy/clipped"):
        assert float(found[name]) == pytest.approx(wanted[name], rel=2e-3, abs=1e-5), name


def test_steps_are_those_of_all_who_learn():
    assert trainer().steps_per_update == DRONES * RACES * STEPS
    assert replace(ALL_LEARN, opponents=TINY.opponents).steps_per_update == RACES * STEPS


def test_a_run_learns_from_all_and_goes_on():
    """A few updates: finite, and the policy of the run is no longer the one it began with."""
    run = Trainer(replace(ALL_LEARN, step_scale=0.001), TRACKS["ring"], VEHICLES["paper"])
    *_, last = run.run(run.initial_state())
    assert last.steps == run.total_steps
    assert float(jnp.abs(last.state.model.log_std - run.initial_state().model.log_std).max()) > 1e-3


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"against": "ring-2"}, "leaves against no drone to fly"),
        ({"opponents": replace(ALL_LEARN.opponents, league=4)}, "leaves league no drone to fly"),
        ({"ppo": replace(ALL_LEARN.ppo, network="gru")}, "needs a policy without memory"),
    ],
)
def test_what_does_not_go_with_it_is_told(changes, fault):
    with pytest.raises(CruiseError, match=fault):
        check_config(replace(ALL_LEARN, **changes))
    check_config(replace(ALL_LEARN, drones=1, **{k: v for k, v in changes.items() if k != "against"}))
