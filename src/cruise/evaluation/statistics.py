"""Means, deviations and 95 % intervals over races.

A race is the independent unit. The drones of one race are not independent of each other (two that collide are both
out), so every race gives one number, and intervals are over those.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

CONFIDENCE = 0.95
_UPPER = (1 + CONFIDENCE) / 2  # quantile of a two-sided interval's upper end


@dataclass(frozen=True)
class Estimate:
    """A measured quantity. NaN where it was not observed, or too seldom."""

    mean: float
    std: float  # between races, with n - 1
    low: float  # of the 95 % interval of the mean
    high: float

    def to_dict(self) -> dict[str, float | None]:
        """For JSON: NaN becomes null."""
        fields = {"mean": self.mean, "std": self.std, "low": self.low, "high": self.high}
        return {name: None if math.isnan(value) else float(value) for name, value in fields.items()}


def mean_estimate(per_race: Sequence[float] | np.ndarray) -> Estimate:
    """Mean with Student's interval; races without a value (NaN) are left out."""
    values = _observed(per_race)
    if len(values) == 0:
        return Estimate(math.nan, math.nan, math.nan, math.nan)
    mean, std = float(values.mean()), _std(values)
    half = special.stdtrit(len(values) - 1, _UPPER) * std / math.sqrt(len(values)) if len(values) > 1 else math.nan
    return Estimate(mean, std, mean - half, mean + half)


def count_estimate(per_race: Sequence[float] | np.ndarray) -> Estimate:
    """Mean of a count of rare events.

    Student's interval, but never below 0, and never ending below what so many races without any event leave open
    (Garwood's exact Poisson limit, 3.69 / races): no event seen does not mean that none can happen.
    """
    values = _observed(per_race)
    estimate = mean_estimate(values)
    if len(values) < 2:
        return estimate
    none_seen = -math.log(1 - _UPPER) / len(values)
    return Estimate(estimate.mean, estimate.std, max(estimate.low, 0.0), max(estimate.high, none_seen))


def rate_estimate(per_race: Sequence[float] | np.ndarray, drones: int) -> Estimate:
    """A success rate: the share of `drones` in each race, with Wilson's interval on the effective number of trials.

    As many independent trials as give the variance seen between races, at least one and at most `drones` per race;
    one per race where every race agrees, because nothing then tells how far drones of a race depend on each other.
    """
    values = _observed(per_race)
    if len(values) == 0:
        return Estimate(math.nan, math.nan, math.nan, math.nan)
    rate, races = float(values.mean()), len(values)
    variance = float(values.var(ddof=1)) if races > 1 else 0.0
    per_trial = rate * (1 - rate) / variance if variance > 0 else 1.0
    trials = races * min(max(per_trial, 1.0), float(drones))
    low, high = wilson(rate, trials)
    return Estimate(rate, _std(values), low, high)


def wilson(rate: float, trials: float) -> tuple[float, float]:
    """Wilson's score interval (1927) of a proportion; `trials` need not be whole."""
    z = float(special.ndtri(_UPPER))
    centre = (rate + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials**2))
    return max(0.0, centre - half) if rate > 0 else 0.0, min(1.0, centre + half) if rate < 1 else 1.0


def _observed(per_race: Sequence[float] | np.ndarray) -> np.ndarray:
    values = np.asarray(per_race, np.float64)
    return values[~np.isnan(values)]


def _std(values: np.ndarray) -> float:
    return float(values.std(ddof=1)) if len(values) > 1 else math.nan
