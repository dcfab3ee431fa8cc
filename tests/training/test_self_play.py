"""The win rate, who is replaced when, and evaluations against a race flown step by step."""

import itertools
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import SelfPlayConfig
from cruise.pilots.network import ActorCritic
from cruise.training import self_play
from cruise.training.random_keys import evaluation_keys
from cruise.training.self_play import Score, has_mastered, may_replace, play_on, replace_opponents, win_rate
from cruise.training.trainer import Trainer
from tests.training.replay import compiled_env, fly, networks_actions
from tests.training.runs import RACES, STEPS, TINY, bits, last_rules, shared_trainer, tiny_trainer, whole_run


@pytest.mark.parametrize("drones", [2, 3, 4])
def test_win_rate_is_the_papers_equation(drones):
    """w = mean over races of the indicator that the active drone passed strictly more gates than all others."""
    gates = np.random.default_rng(drones).integers(0, 4, size=(drones, 50))
    wins = [all(race[0] > other for other in race[1:]) for race in gates.T]
    assert 0 < sum(wins) < 50
    assert float(win_rate(jnp.asarray(gates))) == pytest.approx(sum(wins) / 50)


def test_a_tie_is_no_win():
    ties = jnp.array([[3, 3, 3, 0, 4, 2], [3, 1, 4, 0, 3, 2], [3, 3, 0, 0, 3, 1]])
    assert float(win_rate(ties)) == pytest.approx(1 / 6)
    assert float(win_rate(jnp.array([[2, 5]]))) == 0.0  # nobody to win against


def score(win: float) -> Score:
    return Score(win, 1.0, 3.0, 10.0)


@pytest.mark.parametrize("patience", [0, 1, 2, 5])
def test_replaced_at_tau_or_when_patience_runs_out(patience):
    config = SelfPlayConfig(win_threshold=0.6, patience=patience)
    state = tiny_trainer().initial_state()
    assert has_mastered(state, score(0.6), config)
    assert has_mastered(state, score(1.0), config)
    verdicts = []
    for _ in range(8):
        verdicts.append(has_mastered(state, score(0.59), config))
        state = play_on(state)
    # Patience 0 is Algorithm 1 to the letter: however long it lasts.
    assert verdicts == [0 < patience <= failures for failures in range(1, 9)]
    assert not has_mastered(replace_opponents(state), score(0.59), replace(config, patience=2))


def test_replacement_copies_the_active_policy_and_keeps_the_generation_before():
    state = whole_run()[5].state
    state = state._replace(opponents=state.opponents._replace(failed=jnp.asarray(3, jnp.int32)))
    after = replace_opponents(state)
    assert bits(after.opponents.newest) == bits(state.policy)
    assert bits(after.opponents.previous) == bits(state.opponents.newest)
    assert np.asarray(after.opponents.uses_previous).all()
    assert int(after.opponents.failed) == 0
    for name in ("model", "optimiser", "races", "restart", "key", "updates"):
        assert bits(getattr(after, name)) == bits(getattr(state, name)), name
    waiting = play_on(state)
    assert int(waiting.opponents.failed) == 4
    assert bits(waiting.opponents[:3]) == bits(state.opponents[:3])


def test_no_replacement_while_a_race_flies_by_the_older_generation():
    state = tiny_trainer().initial_state()
    assert may_replace(state)
    for share in (1.0, 0.3, 1 / RACES):
        older = jnp.arange(RACES) < share * RACES
        assert not may_replace(state._replace(opponents=state.opponents._replace(uses_previous=older)))
    assert not may_replace(replace_opponents(state))


def test_learning_never_touches_the_opponents():
    """Through the whole run each generation stays, bit for bit, the policy that it was copied from."""
    run = whole_run()
    newest = previous = bits(tiny_trainer().initial_state().model)
    replacements = 0
    for progress in run:
        pool = progress.state.opponents
        if progress.opponents_replaced:
            newest, previous, replacements = bits(progress.state.policy), newest, replacements + 1
        assert bits(pool.newest) == newest
        assert bits(pool.previous) == previous
        assert bits(progress.state.model) != bits(run[0].state.model) or progress is run[0]
    assert replacements > 3
    assert sum(progress.score is not None for progress in run) > replacements


def test_a_replacement_waits_for_the_races_under_way():
    """Right after one every race flies on by the previous generation; none is dropped before they have all ended."""
    older = np.zeros(RACES, bool)
    for progress in whole_run():
        now = np.asarray(progress.state.opponents.uses_previous)
        if progress.opponents_replaced:
            assert (np.asarray(progress.state.races.step)[older] < STEPS).all()  # all have begun anew since
            assert now.all()
        else:
            assert not (now & ~older).any()  # nobody goes back
        older = now & ~np.asarray(progress.state.restart)
    delayed = [p for p in whole_run() if p.score is not None and not p.opponents_replaced]
    assert delayed  # patience is 1, so only races under way can have held it up


def pilot(thrust: float, aside: float = 0.0) -> ActorCritic:
    """A policy that always says the same: forward, and a little to the left."""
    model = tiny_trainer().initial_state().model
    flat = jax.tree.map(jnp.zeros_like, model)
    return eqx.tree_at(lambda m: m.actor.layers[-1].bias, flat, jnp.array([thrust, aside, 0.0], jnp.float32))


def fly_evaluation(model: ActorCritic, opponents: ActorCritic, alone: bool, key: jax.Array) -> Score:
    """The same evaluation race by race, in plain Python."""
    env, rules = compiled_env(), last_rules()
    races = env.reset(key, (RACES,))
    races = races._replace(out=races.out.at[1:].set(alone))
    airborne_speeds = []
    for _ in range(TINY.opponents.evaluation_steps):
        seen = np.asarray(env.observe(races))
        actions = np.stack([networks_actions(model, seen[:, 0]), networks_actions(opponents, seen[:, 1])], axis=1)
        flying = ~np.asarray(races.out[0])
        races, _ = fly(env, races, actions, rules)
        airborne_speeds += list(np.linalg.norm(races.drones.velocity_w[:, 0, flying], axis=0))
    passed, out = np.asarray(races.gates_passed), np.asarray(races.out)
    return Score(np.mean(passed[0] > passed[1]), np.mean(~out[0]), np.mean(airborne_speeds), np.nan)


@pytest.mark.parametrize("case", ["equal", "faster", "slower", "alone"])
def test_evaluation_is_the_race_flown_step_by_step(case):
    trainer, origin = tiny_trainer(), np.array([10, 7], np.uint32)
    key = evaluation_keys(origin)[0]
    mine, theirs = {"equal": (0.6, 0.6), "faster": (1.0, 0.12), "slower": (0.12, 1.0), "alone": (0.6, 1.0)}[case]
    model, opponents = pilot(mine, 0.05), pilot(theirs)
    found = trainer.evaluate(model, opponents, last_rules(), np.asarray(case == "alone"), origin, None)
    expected = fly_evaluation(model, opponents, case == "alone", key)
    np.testing.assert_allclose(found[:3], expected[:3], atol=1e-4)
    assert np.isnan(found.lap_time)  # nobody flies a lap in 3 s
    assert {"faster": found.win_rate > 0.6, "slower": found.win_rate < 0.1}.get(case, True)
    assert 0 < found.success <= 1


def test_lap_time_is_that_of_whole_laps_flown_by_survivors():
    """Two laps in 200 steps, one in 120; less than a lap and a crash do not count. The ring has 5 gates."""
    races = tiny_trainer().initial_state().races
    gates = jnp.zeros((2, RACES), jnp.int32).at[0, :4].set(jnp.array([11, 6, 5, 12]))
    races = races._replace(gates_passed=gates, out=jnp.zeros((2, RACES), bool).at[0, 3].set(True))
    last = jnp.full(RACES, 10.5).at[:4].set(jnp.array([210.5, 130.5, 90.5, 50.5]))
    ones = jnp.ones(RACES)
    seen = self_play._Watch(first_gate=jnp.full(RACES, 10.5), last_gate=last, distance=40 * ones, steps=10 * ones)
    found = self_play._score(seen, races, tiny_trainer().env)
    assert float(found.lap_time) == pytest.approx((10.0 + 12.0) / 2)
    assert float(found.speed) == pytest.approx(4.0)
    assert float(found.success) == pytest.approx(1 - 1 / RACES)
    assert float(found.win_rate) == pytest.approx(4 / RACES)


def test_evaluations_of_a_run_are_against_the_newest_opponents():
    """And each on starts of its own, a function of the seed and the update."""
    trainer, run = tiny_trainer(), whole_run()
    checked = 0
    for before, now in itertools.pairwise(run):
        if now.score is None or now.opponents_replaced:
            continue
        origin = np.array([TINY.seed, now.state.updates], np.uint32)
        opponents = before.state.opponents.newest
        again = trainer.evaluate(
            now.state.policy, opponents, trainer.rules_of(now.phase), np.asarray(False), origin, None
        )
        np.testing.assert_array_equal(now.score[:4], [float(x) for x in again[:4]])
        checked += 1
    assert checked


def opponents_after(mode_phase, win: float) -> tuple:
    """(state before, score, state after, whether they were replaced) of one evaluation that ends with this win rate."""
    trainer: Trainer = shared_trainer(TINY)
    trainer.evaluate = lambda *_: Score(*(jnp.asarray(x) for x in (win, 1.0, 3.0, 9.0)))
    state = trainer.initial_state()
    return state, *trainer._evaluate_and_replace(state, mode_phase, last_rules(), jnp.asarray(False))


@pytest.mark.parametrize("self_play", [True, False])
def test_only_self_play_replaces(self_play):
    phase = replace(tiny_trainer().phases[-1], self_play=self_play)
    before, found, after, replaced = opponents_after(phase, win=1.0)
    assert found == Score(1.0, 1.0, 3.0, 9.0)
    assert replaced == self_play
    assert (bits(before) == bits(after)) == (not self_play)
