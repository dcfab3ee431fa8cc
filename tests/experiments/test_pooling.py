"""Pooled means and intervals against computations of their own."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from experiments.plan import Job, full_scale
from experiments.pooling import NOTHING, Pooled, compare, pool, pool_count, pool_rate, summarise_cells
from tests.experiments.invented import invent_cell

SEEDS = [[4.1, 4.3, None, 4.2], [4.6, 4.4], [None, 4.0, 4.1]]


def test_student_over_the_seeds_means():
    means = [np.mean([v for v in seed if v is not None]) for seed in SEEDS]
    low, high = stats.t.interval(0.95, len(means) - 1, loc=np.mean(means), scale=stats.sem(means))
    pooled = pool(SEEDS)
    assert (pooled.mean, pooled.low, pooled.high) == pytest.approx((np.mean(means), low, high))
    assert (pooled.seeds, pooled.races) == (3, 7)


def test_races_alone_do_not_narrow_the_interval():
    few, many = [[1.0], [2.0], [3.0]], [[1.0] * 1000, [2.0] * 1000, [3.0] * 1000]
    assert pool(few).high - pool(few).low == pytest.approx(pool(many).high - pool(many).low)


def test_one_seed_speaks_for_its_races():
    values = [4.1, 4.3, 4.2, 4.6]
    low, high = stats.t.interval(0.95, 3, loc=np.mean(values), scale=stats.sem(values))
    pooled = pool([values, [None, None]])
    assert (pooled.low, pooled.high, pooled.seeds) == (pytest.approx(low), pytest.approx(high), 1)


def test_nothing_observed():
    for pooled in (pool([]), pool([[None], []]), pool_rate([], 4)):
        assert not pooled.known
        assert (pooled.seeds, pooled.races) == (0, 0)


def test_all_seeds_perfect_prove_no_perfection():
    """Student's interval of three equal rates has no width; so many races leave more open than that."""
    pooled = pool_rate([[1.0] * 100] * 3, 1)
    expected = stats.binomtest(300, 300).proportion_ci(0.95, method="wilson").low
    assert pooled.mean == 1.0
    assert pooled.low == pytest.approx(expected)
    assert pooled.high == 1.0


def test_a_rate_is_no_narrower_than_its_seeds_say():
    rates = [[0.0] * 50, [1.0] * 50, [1.0] * 25 + [0.0] * 25]
    pooled = pool_rate(rates, 1)
    assert pooled.mean == pytest.approx(0.5)
    assert (pooled.low, pooled.high) == (0.0, 1.0)  # Student's reaches beyond, and is cut


shares = st.lists(st.lists(st.sampled_from([0.0, 0.25, 0.5, 1.0]), min_size=1, max_size=20), min_size=1, max_size=4)


@given(shares)
def test_rates_lie_in_their_interval_and_in_bounds(values):
    pooled = pool_rate(values, 4)
    assert 0.0 <= pooled.low <= pooled.mean + 1e-12
    assert pooled.mean - 1e-12 <= pooled.high <= 1.0


@given(shares, st.randoms())
def test_the_order_of_seeds_and_races_does_not_matter(values, random):
    mixed = [random.sample(seed, len(seed)) for seed in values]
    random.shuffle(mixed)
    one, other = pool_rate(values, 4), pool_rate(mixed, 4)
    assert (one.mean, one.low, one.high) == pytest.approx((other.mean, other.low, other.high))


def test_counts_do_not_reach_below_zero():
    pooled = pool_count([[0, 0], [0, 1], [0, 0]])
    assert pool([[0, 0], [0, 1], [0, 0]]).low < 0 == pooled.low


def test_only_disjoint_intervals_are_told_apart():
    low, high, wide = Pooled(1, 0.9, 1.1, 3, 9), Pooled(2, 1.9, 2.1, 3, 9), Pooled(1.5, 1.0, 2.0, 3, 9)
    assert compare(high, low) == "higher"
    assert compare(low, high) == "lower"
    assert compare(wide, high) == compare(low, wide) == "not told apart"
    assert compare(NOTHING, low) == compare(low, NOTHING) == "not known"


def test_a_summary_of_cells():
    cells = [invent_cell(Job("cruise", "ring", 4, seed), full_scale()) for seed in range(3)]
    length = 58.95
    summary = summarise_cells(cells, length)
    success = [np.mean(cell.measured.success) for cell in cells]
    whole = [np.mean(np.array(cell.measured.success) == 1.0) for cell in cells]
    nominal = [np.mean([length / v for v in cell.measured.speed if v]) for cell in cells]
    assert summary.seeds == (0, 1, 2)
    assert summary.success.mean == pytest.approx(np.mean(success))
    assert summary.all_success.mean == pytest.approx(np.mean(whole))
    assert summary.nominal_lap.mean == pytest.approx(np.mean(nominal))
    assert summary.nominal_lap.low == pytest.approx(stats.t.interval(0.95, 2, np.mean(nominal), stats.sem(nominal))[0])
    assert not math.isnan(summary.overtakes.low)
