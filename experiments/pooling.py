"""What several seeds say together.

A training seed is the independent unit: every seed gives one mean, and intervals are over those. Races of one policy
tell nothing of how another training would have come out, so they widen an interval but never narrow it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cruise.evaluation.statistics import mean_estimate, rate_estimate
from experiments.results import Cell, Measured

Verdict = Literal["higher", "lower", "not told apart", "not known"]
Values = Sequence[Sequence[float | None]]  # per seed, per race; None where nothing was measured


@dataclass(frozen=True)
class Pooled:
    """A quantity over seeds. NaN where it was not observed."""

    mean: float
    low: float  # of the 95 % interval
    high: float
    seeds: int  # that observed it
    races: int  # that did

    @property
    def known(self) -> bool:
        """Whether it was observed at all."""
        return not math.isnan(self.mean)

    def times(self, factor: float) -> "Pooled":
        """In another unit."""
        return replace(self, mean=factor * self.mean, low=factor * self.low, high=factor * self.high)


NOTHING = Pooled(math.nan, math.nan, math.nan, 0, 0)


def pool(values: Values) -> Pooled:
    """Mean over the seeds' means with Student's interval; with one seed, over its races."""
    observed = [found for found in ([v for v in seed if v is not None] for seed in values) if found]
    races = sum(len(found) for found in observed)
    if not observed:
        return NOTHING
    numbers = [float(np.mean(found)) for found in observed] if len(observed) > 1 else observed[0]
    estimate = mean_estimate(numbers)
    return Pooled(estimate.mean, estimate.low, estimate.high, len(observed), races)


def pool_rate(values: Values, trials: int) -> Pooled:
    """Mean over the seeds' rates, in [0, 1].

    Student's interval over seeds, but never narrower than the one that all races together leave open (Wilson's, see
    `cruise.evaluation.statistics.rate_estimate`): three seeds at exactly 100 % do not prove that none can fail.

    Args:
        values: the share of `trials` that succeeded, per seed and race.
        trials: drones of a race that each share counts.
    """
    whole = pool(values)
    if not whole.known:
        return whole
    races = rate_estimate([value for seed in values for value in seed if value is not None], trials)
    low = max(0.0, np.fmin(whole.low, races.low))
    high = min(1.0, np.fmax(whole.high, races.high))
    return Pooled(whole.mean, float(low), float(high), whole.seeds, whole.races)


def pool_count(values: Values) -> Pooled:
    """Mean of a count, whose interval does not reach below 0."""
    whole = pool(values)
    return replace(whole, low=max(0.0, whole.low)) if whole.low < 0 else whole


def compare(one: Pooled, other: Pooled) -> Verdict:
    """Whether `one` is higher than `other`: only where their intervals do not overlap."""
    if not (one.known and other.known):
        return "not known"
    if one.low > other.high:
        return "higher"
    return "lower" if one.high < other.low else "not told apart"


@dataclass(frozen=True)
class Summary:
    """A kind of pilot on a track, over its seeds. Definitions as in `docs/race-log.md`."""

    seeds: tuple[int, ...]
    success: Pooled  # of drones
    all_success: Pooled  # of races: every drone finished
    speed: Pooled  # mean speed of drones that finished [m/s]
    air_speed: Pooled  # of all drones while in the air [m/s]
    lap: Pooled  # timed flying lap [s]
    nominal_lap: Pooled  # length of the track / mean speed [s]
    first_lap: Pooled  # from standing [s]
    collisions: Pooled  # per race
    overtakes: Pooled  # per race


def summarise(measured: Sequence[Measured], seeds: tuple[int, ...], lap_length: float) -> Summary:
    """Pool measurements, one per seed."""
    success = [m.success for m in measured]
    drones = measured[0].drones
    return Summary(
        seeds=seeds,
        success=pool_rate(success, drones),
        all_success=pool_rate([[float(share == 1.0) for share in seed] for seed in success], 1),
        speed=pool([m.speed for m in measured]),
        air_speed=pool([m.air_speed for m in measured]),
        lap=pool([m.lap for m in measured]),
        nominal_lap=pool([[None if v is None else lap_length / v for v in m.speed] for m in measured]),
        first_lap=pool([m.first_lap for m in measured]),
        collisions=pool_count([m.collisions for m in measured]),
        overtakes=pool_count([m.overtakes for m in measured]),
    )


def summarise_cells(cells: Sequence[Cell], lap_length: float) -> Summary:
    """Pool the final measurements of cells that differ in their seed alone."""
    return summarise([cell.measured for cell in cells], tuple(cell.seed for cell in cells), lap_length)
