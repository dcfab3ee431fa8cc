"""The league: who flies which races, who flies, who joins and who leaves, and its ratings."""

import copy
import functools
from collections import Counter
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import TrainConfig
from cruise.errors import CruiseError
from cruise.presets import TRACKS, VEHICLES
from cruise.storage.policy_file import read_policy
from cruise.training import league as leagues
from cruise.training import session
from cruise.training.league import SHARES, SLOTS, choose_members, found_league, join, keep_score, opponents_fly
from cruise.training.metrics_log import read_metrics
from cruise.training.session import Session
from cruise.training.trainer import Progress, Trainer
from cruise.training.types import League, OpponentPool
from cruise.training.validation import check_config
from tests.training import reference
from tests.training.runs import RACES, TINY, bits, open_session, random_model, tiny_trainer, uninterrupted

__all__ = ["open_session", "uninterrupted"]  # fixtures

PLACES = 6
CONFIG = replace(TINY, step_scale=0.0006, opponents=replace(TINY.opponents, league=PLACES))


@functools.cache
def trainer() -> Trainer:
    return Trainer(CONFIG, TRACKS["ring"], VEHICLES["paper"])


def compiled_trainer(config: TrainConfig, *_: object) -> Trainer:
    """One for other founders, which asks for no other program."""
    same = copy.copy(trainer())
    same.config = config
    return same


@functools.cache
def run() -> tuple[Progress, ...]:
    return tuple(trainer().run(trainer().initial_state()))


def some_league(beaten: list[float], joined: list[int] | None = None) -> League:
    model = tiny_trainer().initial_state().model
    league = found_league(model, len(beaten), [random_model(k, model) for k in range(len(beaten))])
    league = league._replace(beaten=jnp.asarray(beaten, jnp.float32))
    return league if joined is None else league._replace(joined=jnp.asarray(joined))


def test_half_of_the_races_meet_the_newest_and_each_member_an_eighth():
    """Compared with each network alone, race by race, and generation by generation."""
    like = tiny_trainer().initial_state().model
    league = some_league([0.5] * PLACES)._replace(flying=jnp.array([4, 0, 5, 2]))
    newest, previous = random_model(20, like), random_model(21, like)
    rng = np.random.default_rng(0)
    older = rng.random(3 * SHARES) < 0.5
    observation = rng.normal(size=(like.actor.layers[0].in_features, 3, 3 * SHARES)).astype(np.float32)
    pool = OpponentPool(newest, previous, jnp.asarray(older), jnp.asarray(0))
    found = np.asarray(opponents_fly(pool, league, (), jnp.asarray(observation))[1])
    for race in range(3 * SHARES):
        share = race % SHARES
        flying = [random_model(k, like) for k in (4, 0, 5, 2)]
        model = (previous if older[race] else newest) if share < SLOTS else flying[share - SLOTS]
        for drone in range(3):
            expected = reference.mean_action(model, observation[:, drone, race : race + 1])
            np.testing.assert_allclose(found[:, drone, race : race + 1], expected, atol=1e-4)


def drawn_from(league: League, times: int) -> jax.Array:
    """Who flies, drawn so often: [times, SLOTS]."""
    return jax.jit(jax.vmap(functools.partial(choose_members, league)))(jax.random.split(jax.random.key(0), times))


def test_who_is_beaten_seldom_flies_often_and_nobody_twice():
    league = some_league([0.0, 0.5, 0.9, 1.0, 1.0, 1.0])
    drawn = np.asarray(drawn_from(league, 2000))
    assert all(len(set(row)) == SLOTS for row in drawn)
    first = Counter(drawn[:, 0].tolist())
    weight = (1 - np.asarray(league.beaten)) ** 2 + leagues.LEAST_WEIGHT
    for place in range(PLACES):
        assert first[place] / 2000 == pytest.approx(weight[place] / weight.sum(), abs=0.03)


def test_empty_places_never_fly():
    league = some_league([0.5] * PLACES, joined=[-1, 3, -1, 7, -1, -1])
    assert set(np.unique(drawn_from(league, 50)).tolist()) <= {1, 3}


def test_ratings_are_elos_and_scores_fade():
    """R' = R + 32 (S - 1 / (1 + 10^((R_m - R) / 400))), against each member that flew."""
    league = some_league([0.5] * PLACES)
    league = league._replace(rating=jnp.array([1200.0, 1000, 1000, 1000, 900, 800]), flying=jnp.array([0, 1, 4, 5]))
    beaten = np.array([0.9, 0.5, 0.0, 1.0])
    after = keep_score(league, jnp.asarray(beaten, jnp.float32))
    rivals = np.array([1200.0, 1000, 900, 800])
    gained = 32 * (beaten - 1 / (1 + 10 ** ((rivals - 1000) / 400)))
    np.testing.assert_allclose(after.rating[jnp.array([0, 1, 4, 5])], rivals - gained, rtol=1e-5)
    np.testing.assert_allclose(after.own_rating, 1000 + gained.mean(), rtol=1e-5)
    np.testing.assert_allclose(after.beaten, [0.62, 0.5, 0.5, 0.5, 0.35, 0.65], rtol=1e-5)


def test_a_policy_takes_a_free_place_then_that_of_the_most_beaten_but_never_a_founders():
    state = tiny_trainer().initial_state()._replace(updates=jnp.asarray(9))
    full = some_league([1.0, 0.2, 0.8, 0.9, 0.3, 0.4])._replace(flying=jnp.array([0, 1, 2, 3]))
    free = full._replace(joined=jnp.array([0, 0, -1, 0, -1, 0]))
    for league, founders, place in ((free, 1, 2), (full, 0, 0), (full, 1, 3)):
        after = join(state._replace(league=league), founders)
        assert bits(jax.tree.map(lambda leaf: leaf[place], after.league.members)) == bits(state.policy)  # noqa: B023
        others = np.arange(PLACES) != place
        for was, now in zip(jax.tree.leaves(league.members), jax.tree.leaves(after.league.members), strict=True):
            np.testing.assert_array_equal(np.asarray(was)[others], np.asarray(now)[others])
        assert after.league.joined[place] == 9
        assert after.league.beaten[place] == leagues.UNKNOWN
        anew = (np.arange(RACES) % SHARES == SLOTS + place) & (
            place < SLOTS
        )  # its races, as it flew in the slot so numbered
        np.testing.assert_array_equal(after.restart, np.asarray(state.restart) | anew)


def test_a_league_of_founders_alone_takes_nobody_in():
    state = tiny_trainer().initial_state()._replace(league=some_league([0.9] * PLACES))
    assert bits(join(state, PLACES)) == bits(state)


def test_the_beaten_share_counts_single_opponents_and_ties_by_half():
    gates = np.zeros((3, SHARES), int)
    gates[:, SLOTS] = (5, 4, 5)  # one beaten, one even
    gates[:, SLOTS + 1] = (5, 6, 7)
    gates[:, 0] = (9, 0, 0)  # against the newest: does not count
    np.testing.assert_allclose(leagues.beaten_by_slot(jnp.asarray(gates)), [0.75, 0.0, 0.5, 0.5])


def test_training_fills_the_league_with_the_policies_of_its_replacements():
    """Replayed from what the run reports: who joined, when, and where."""
    replaced = [k for k, progress in enumerate(run()) if progress.opponents_replaced]
    assert len(replaced) >= 3
    last = run()[-1].state.league
    joined = [int(run()[k].state.updates) for k in replaced]
    if len(joined) < PLACES:
        assert np.asarray(last.joined).tolist() == [0, *joined, *[-1] * (PLACES - 1 - len(joined))]
    for k in replaced:
        before, after = run()[k - 1].state.league, run()[k].state.league
        place = int(np.flatnonzero(np.asarray(before.joined) != np.asarray(after.joined))[0])
        assert bits(jax.tree.map(lambda leaf: leaf[place], after.members)) == bits(run()[k].state.policy)  # noqa: B023


def test_races_whose_opponents_change_begin_anew_and_no_others():
    evaluated = [k for k, progress in enumerate(run()) if progress.score is not None and k]
    changed = 0
    for k in evaluated:
        before, after = run()[k - 1].state.league, run()[k].state.league
        slots = np.asarray(before.flying) != np.asarray(after.flying)
        changed += slots.sum()
        restart = np.asarray(run()[k].state.restart).reshape(-1, SHARES)
        assert restart[:, SLOTS:][:, slots].all()
    assert changed


def test_a_run_with_a_league_logs_its_standing_and_resumes_exactly(uninterrupted, monkeypatch, tmp_path):
    founder = str(uninterrupted.folder / "stage-5")
    monkeypatch.setattr(session, "Trainer", compiled_trainer)
    config = replace(CONFIG, opponents=replace(CONFIG.opponents, founders=(founder,)))
    track, vehicle = TRACKS["ring"], VEHICLES["paper"]
    whole = Session(tmp_path / "whole", config, track, vehicle)
    place = jax.tree.map(lambda leaf: leaf[0], whole.state.league.members)
    assert bits(place) == bits(read_policy(founder).params)
    for _ in whole:
        pass
    assert bits(jax.tree.map(lambda leaf: leaf[0], whole.state.league.members)) == bits(place)
    rows = [row for row in read_metrics(tmp_path / "whole") if "league/rating" in row]
    assert rows
    assert all(1 <= row["league/members"] <= PLACES for row in rows)
    part = Session(tmp_path / "part", replace(config, checkpoint_seconds=1e-6), track, vehicle)
    for progress in part:
        if int(progress.state.updates) == 7:
            break
    rest = Session(tmp_path / "part", config, track, vehicle, resume=True)
    for _ in rest:
        pass
    assert bits(rest.state) == bits(whole.state)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"league": -1}, "league must be 0 or more, not -1"),
        ({"league": 1, "founders": ("a", "b")}, "2 founders need as many places: league is 1"),
    ],
)
def test_leagues_that_cannot_be_are_refused(changes, words):
    with pytest.raises(CruiseError, match=words):
        check_config(replace(TINY, opponents=replace(TINY.opponents, **changes)))


def test_races_that_cannot_be_shared_are_refused():
    config = replace(CONFIG, ppo=replace(CONFIG.ppo, races=68, rollout_steps=16))
    with pytest.raises(CruiseError, match=f"a multiple of {SHARES} races"):
        Trainer(config, TRACKS["ring"], VEHICLES["paper"])
