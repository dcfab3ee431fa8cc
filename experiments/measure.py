"""Races flown and turned into the numbers that are kept."""

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cruise.evaluation.matches import Match, run_races
from cruise.evaluation.metrics import DroneResult, RaceResult, race_result
from cruise.pilots.neural import NeuralPilot
from cruise.storage.policy_file import load_policy
from experiments.results import Curve, Measured, Numbers

FRESH = 2000  # added to a job's seed: the seed of its races
DIGITS = 6  # significant, of what is kept
CURVE_POINTS = 100


def load_as(path: Path, name: str) -> NeuralPilot:
    """A policy under another name: policies of all seeds that go by one name need one compilation."""
    return dataclasses.replace(load_policy(path), name=name)


def measure(match: Match, races: int, seed: int) -> Measured:
    """Fly races of one pilot against itself."""
    return measured_of([race_result(log) for log in run_races(match, races, FRESH + seed)], FRESH + seed)


def measured_of(results: Sequence[RaceResult], seed: int) -> Measured:
    """What is kept of races."""
    fates = Counter(drone.fate for race in results for drone in race.drones)
    return Measured(
        seed=seed,
        drones=len(results[0].drones),
        success=tuple(_kept(np.mean([drone.finished for drone in race.drones])) or 0.0 for race in results),
        speed=_finishers(results, lambda drone: drone.mean_speed),
        air_speed=tuple(_kept(np.mean([drone.mean_speed for drone in race.drones])) for race in results),
        lap=_finishers(results, lambda drone: drone.flying_lap_time),
        first_lap=_finishers(results, lambda drone: drone.first_lap_time),
        collisions=tuple(sum(race.collisions.values()) for race in results),
        overtakes=tuple(race.overtakes for race in results),
        fates=dict(sorted(fates.items())),
    )


def _finishers(results: Sequence[RaceResult], quantity: Callable[[DroneResult], float]) -> Numbers:
    means = []
    for race in results:
        values = [quantity(drone) for drone in race.drones if drone.finished]
        means.append(_kept(np.mean(values)) if values else None)
    return tuple(means)


def _kept(value: Any) -> float | None:
    """So many digits; None for what is not a number."""
    number = float(value)
    return float(f"{number:.{DIGITS}g}") if math.isfinite(number) else None


def thin_curve(rows: Sequence[dict[str, Any]], points: int = CURVE_POINTS) -> Curve:
    """A run's metrics (`cruise.training.metrics_log.read_metrics`) in at most so many points."""
    stretches = [rows[i[0] : i[-1] + 1] for i in np.array_split(np.arange(len(rows)), min(points, len(rows))) if len(i)]

    def last(name: str) -> Numbers:
        found = ([row[name] for row in stretch if name in row] for stretch in stretches)
        return tuple(_kept(values[-1]) if values else None for values in found)

    return Curve(
        steps=tuple(stretch[-1]["steps"] for stretch in stretches),
        stage=tuple(stretch[-1]["stage"] for stretch in stretches),
        reward=tuple(_kept(np.mean([row["reward"] for row in stretch])) for stretch in stretches),
        speed=last("evaluation/speed"),
        success=last("evaluation/success"),
        lap=last("evaluation/lap_time"),
        win_rate=last("evaluation/win_rate"),
    )
