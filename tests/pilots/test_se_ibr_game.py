"""Rounds of best responses: laws that hold for any traffic, and what the sensitivity is for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.pilots.se_ibr.game import best_responses, shifted
from cruise.pilots.se_ibr.options import Algorithm
from examples.se_ibr_blocking import CASES, duel
from tests.helpers import assert_trees_close
from tests.pilots.traffic import LINE, STYLE, bunch, guess_of

ALGORITHM = Algorithm(limit="box")


@jax.jit
def planned(traffic, guess):
    return best_responses(LINE, ALGORITHM, STYLE, traffic, guess)


def plan_of(traffic, progress):
    return planned(traffic, guess_of(ALGORITHM, traffic, progress))


@pytest.fixture(scope="module")
def scene():
    traffic, progress = bunch(3, (4,), seed=2)
    return traffic, progress, plan_of(traffic, progress)


def test_batched_equals_single(scene):
    traffic, progress, plan = scene
    for race in range(4):
        one = plan_of(jax.tree.map(lambda a, race=race: a[..., race], traffic), progress[:, race])
        assert_trees_close(one, jax.tree.map(lambda a, race=race: a[..., race], plan), atol=5e-3)


def test_drones_have_no_rank(scene):
    """Drones in another order get the same plans in that order."""
    traffic, progress, plan = scene
    order = np.array([2, 0, 1])
    shuffled = plan_of(jax.tree.map(lambda a: jnp.take(a, order, axis=a.ndim - 2), traffic), progress[order])
    np.testing.assert_allclose(shuffled.position_w, plan.position_w[:, :, order], atol=5e-3)
    np.testing.assert_allclose(shuffled.progress, plan.progress[:, order], atol=0.05)


def test_who_is_out_obstructs_nobody(scene):
    """Drone 2 is out: where it lies makes no difference to the others, though it lies in their way."""
    traffic, progress, plan = scene
    out = traffic._replace(airborne=traffic.airborne.at[2].set(False))
    beside = out._replace(position_w=out.position_w.at[:, 2].set(out.position_w[:, 0] + 0.3))
    stale = guess_of(ALGORITHM, traffic, progress)._replace(multipliers=plan.multipliers)  # from when it flew
    here, there = (planned(t, stale) for t in (out, beside))
    np.testing.assert_array_equal(here.position_w[:, :, :2], there.position_w[:, :, :2])
    assert np.abs(here.position_w[:, :, :2] - plan.position_w[:, :, :2]).max() > 0.05  # when it flew it did
    assert float(here.multipliers.collision[0, :, 1].max()) == 0.0  # opponent 1 of drone 1 is drone 2


def test_plans_keep_apart_and_within_limits(scene):
    traffic, _, plan = scene
    points = np.concatenate([traffic.position_w[:, None], plan.position_w], axis=1)
    speed = np.linalg.norm(np.diff(points, axis=1), axis=0) / ALGORITHM.dt
    assert speed.max() < STYLE.speed + 0.1
    end = np.asarray(plan.position_w[:, -1])
    apart = [np.linalg.norm(end[:, i] - end[:, j], axis=0).min() for i, j in ((0, 1), (0, 2), (1, 2))]
    assert min(apart) > 0.7 * STYLE.separation


def test_shifted_by_a_part_of_a_step():
    traffic, progress = bunch(2, (), seed=1)
    guess = guess_of(ALGORITHM, traffic, progress)
    lap = guess._replace(progress=guess.progress + 2 * LINE.length)
    part, whole = (shifted(LINE, lap, steps) for steps in (0.4, 1.0))
    np.testing.assert_allclose(whole.position_w[:, :-1], guess.position_w[:, 1:], atol=1e-5)
    steps = np.diff(guess.position_w, axis=1)
    np.testing.assert_allclose(part.position_w[:, :-1] - guess.position_w[:, :-1], 0.4 * steps, atol=1e-5)
    np.testing.assert_allclose(part.position_w[:, -1] - guess.position_w[:, -1], 0.4 * steps[:, -1], atol=1e-5)
    np.testing.assert_allclose(np.diff(part.progress, axis=0), np.diff(guess.progress, axis=0), atol=1e-3)
    assert (part.progress[0] >= 0).all()
    assert (part.progress[0] < LINE.length).all()


def test_sensitivity_blocks_and_overtakes():
    """A drone that may fly 2.8 m/s starts 2.2 m behind one that may fly 2.5 m/s, in a narrow corridor.

    Without sensitivity it passes. A leader that knows what its place costs the follower keeps it; a follower that knows
    what its place costs the leader passes sooner.
    """
    neither, leader, follower = duel(list(CASES.values()), races=12).passed
    assert np.isfinite(neither).sum() >= np.isfinite(leader).sum() + 3
    assert np.isfinite(follower).all()
    assert np.median(follower) < np.median(neither) - 3.0
