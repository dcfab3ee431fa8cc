"""Sparring partners: how many, who, how they fly, and that they are no more than asked for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.env.race_env import make_race_env
from cruise.pilots.scripted import Chaser
from cruise.presets import TRACKS, VEHICLES
from cruise.training.sparring import SLOWEST, draw_sparring, fly_sparring
from cruise.training.types import Sparring
from tests.training.replay import chase, compiled_env
from tests.training.runs import RACES, TINY, last_rules, moving, tiny_trainer, whole_run


@pytest.mark.parametrize("vehicle", ["paper", "racer"])
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_so_many_opponents_spar_at_every_speed_and_half_of_them_blind(share, vehicle):
    env = make_race_env(TRACKS["ring"], 3, VEHICLES[vehicle], "extended")
    speed, push = (np.asarray(x) for x in draw_sparring(jax.random.key(0), env, 4000, share))
    fastest = VEHICLES[vehicle].tracking.speed
    assert speed.shape == push.shape == (3, 4000)
    assert (speed[0] == 0).all()  # the drone that learns
    by_hand = speed[1:] > 0
    assert by_hand.mean(1) == pytest.approx([share, share], abs=0.03)
    if share:
        shares, _ = np.histogram(speed[1:][by_hand], bins=9, range=(SLOWEST * fastest, fastest))
        assert shares.sum() == by_hand.sum()
        assert shares / shares.sum() == pytest.approx(np.full(9, 1 / 9), abs=0.02)
        assert np.isclose(push[1:][by_hand], Chaser().push).mean() == pytest.approx(0.5, abs=0.03)
        together = (by_hand[0] & by_hand[1]).mean()
        assert together == pytest.approx(share**2, abs=0.03)  # opponents of one race are drawn one by one
    assert set(np.unique(push)) == {0.0, np.float32(Chaser().push)}


def test_a_partner_is_the_chaser_of_its_speed_and_nobody_else_is_touched():
    env, rules = compiled_env(), last_rules()
    races = moving(tiny_trainer().initial_state().races, 3)
    speed = jnp.zeros((2, RACES)).at[1, :2].set(jnp.array([1.0, 4.0]))
    push = jnp.zeros((2, RACES)).at[1, 1].set(2.0)
    flown = jnp.full((3, 2, RACES), 0.5, jnp.float32)
    found = np.asarray(fly_sparring(env, races, flown, Sparring(speed, push), float(rules.agility)))
    for race, (v, p) in enumerate([(1.0, 0.0), (4.0, 2.0)]):
        pilot = Chaser(speed=v, push=p, agility=float(rules.agility))
        _, expected = pilot.act(env, (0, 1), (), races, jax.random.key(0))
        np.testing.assert_allclose(found[:, 1, race], expected[:, 1, race], atol=1e-5)
        assert not np.allclose(found[:, 1, race], 0.5)
    assert (found[:, 0] == 0.5).all()
    assert (found[:, 1, 2:] == 0.5).all()


def test_partners_stay_the_same_for_a_run_and_differ_between_seeds():
    run, first = whole_run(), tiny_trainer().initial_state().sparring
    for progress in (run[0], run[-1]):
        for found, expected in zip(progress.state.sparring, first, strict=True):
            np.testing.assert_array_equal(found, expected)
    share = (np.asarray(first.speed[1]) > 0).mean()
    assert share == pytest.approx(TINY.opponents.sparring_share, abs=0.2)
    other = tiny_trainer().start(jax.random.key(1)).sparring
    assert (np.asarray(other.speed) != np.asarray(first.speed)).any()


def test_partners_race_as_fast_as_they_are_told():
    """Blind, alone in the air, after 12 s: the wanted speed, give or take the controller's lag."""
    env, rules = compiled_env(), last_rules()
    races = env.reset(jax.random.key(5), (RACES,))
    races = races._replace(out=races.out.at[0].set(True))
    wanted = jnp.linspace(0.5, 2.5, RACES)
    sparring = Sparring(jnp.stack([0 * wanted, wanted]), jnp.zeros((2, RACES)))
    for _ in range(120):
        action = chase()(races, sparring, rules.agility)
        races, _ = env.step(races, action, rules)
    speed = np.linalg.norm(races.drones.body.velocity_w[:, 1], axis=0)
    flying = np.asarray(races.airborne[1])
    assert flying.mean() > 0.9
    np.testing.assert_allclose(speed[flying], wanted[flying], rtol=0.25)
    assert np.corrcoef(speed[flying], wanted[flying])[0, 1] > 0.97
