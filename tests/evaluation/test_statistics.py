"""Means and intervals against known values, and intervals that hold what they promise."""

import math

import numpy as np
import pytest
from scipy import stats

from cruise.evaluation.statistics import Estimate, count_estimate, mean_estimate, rate_estimate, wilson

NAN = math.nan


def test_mean_is_students():
    values = np.random.default_rng(0).normal(3.0, 2.0, 12)
    estimate = mean_estimate([*values, NAN])
    low, high = stats.t.interval(0.95, 11, values.mean(), stats.sem(values))
    assert (estimate.mean, estimate.std) == pytest.approx((values.mean(), values.std(ddof=1)))
    assert (estimate.low, estimate.high) == pytest.approx((low, high))


@pytest.mark.parametrize(("successes", "trials"), [(0, 10), (3, 10), (10, 10), (99, 100), (1, 1)])
def test_wilson_is_scipys(successes, trials):
    expected = stats.binomtest(successes, trials).proportion_ci(method="wilson")
    assert wilson(successes / trials, trials) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_rate_of_independent_drones_uses_them_all():
    rng = np.random.default_rng(1)
    shares = rng.binomial(4, 0.9, 2000) / 4
    estimate = rate_estimate(shares, 4)
    assert estimate.high - estimate.low == pytest.approx(np.diff(wilson(shares.mean(), 8000))[0], rel=0.05)


def test_rate_of_drones_that_share_their_fate_uses_races():
    shares = np.random.default_rng(1).binomial(1, 0.9, 500).astype(float)
    estimate = rate_estimate(shares, 4)
    assert (estimate.low, estimate.high) == pytest.approx(wilson(shares.mean(), 500), abs=1e-3)


def test_rate_where_no_race_differs_counts_races():
    assert rate_estimate([1.0] * 100, 4) == Estimate(1.0, 0.0, wilson(1.0, 100)[0], 1.0)
    assert rate_estimate([0.0] * 100, 4) == Estimate(0.0, 0.0, 0.0, wilson(0.0, 100)[1])


def test_counts_stay_positive_and_never_rule_out_the_rare():
    none = count_estimate([0.0] * 100)
    assert (none.mean, none.low) == (0.0, 0.0)
    assert none.high == pytest.approx(stats.chi2.ppf(0.975, 2) / 2 / 100)
    one = count_estimate([1.0] + [0.0] * 99)
    assert one.low == 0.0
    assert one.high >= none.high


@pytest.mark.parametrize("estimate", [mean_estimate, count_estimate, lambda values: rate_estimate(values, 4)])
def test_nothing_observed(estimate):
    assert estimate([NAN, NAN]).to_dict() == {"mean": None, "std": None, "low": None, "high": None}
    one = estimate([1.0, NAN]).to_dict()
    assert (one["mean"], one["std"]) == (1.0, None)


def coverage(sample, truth, estimate, repeats=600):
    """Share of experiments whose interval holds the truth."""
    rng = np.random.default_rng(7)
    found = [estimate(sample(rng)) for _ in range(repeats)]
    return np.mean([e.low <= truth <= e.high for e in found])


def correlated(rng, races=100, drones=4, rate=0.93):
    """Races whose drones share a fate half of the time."""
    together = rng.random((races, 1)) < 0.5
    return np.where(together, rng.random((races, 1)), rng.random((races, drones))) < rate


def test_intervals_hold_what_they_promise():
    """95 % of them contain the truth, within the error of the simulation; too wide is allowed, too narrow is not."""
    assert 0.93 < coverage(lambda rng: rng.gamma(4.0, 0.5, 50), 2.0, mean_estimate) < 0.97
    assert coverage(lambda rng: correlated(rng).mean(axis=1), 0.93, lambda v: rate_estimate(v, 4)) > 0.925
    assert coverage(lambda rng: rng.random(100) < 0.98, 0.98, lambda v: rate_estimate(v, 1)) > 0.93
    assert coverage(lambda rng: rng.poisson(0.01, 100), 0.01, count_estimate) > 0.93
    assert coverage(lambda rng: rng.poisson(1.0, 100), 1.0, count_estimate) > 0.92
