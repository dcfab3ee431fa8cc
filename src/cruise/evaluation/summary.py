"""Many races in a few numbers."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cruise.config import Track
from cruise.evaluation.metrics import DroneResult, RaceResult
from cruise.evaluation.statistics import Estimate, count_estimate, mean_estimate, rate_estimate
from cruise.storage.race_log import COLLISIONS, NOBODY


@dataclass(frozen=True)
class PilotSummary:
    """One pilot among several."""

    name: str
    drones: int  # it flew in every race
    success_rate: Estimate
    win_rate: Estimate  # share of the races that one of its drones won
    flying_lap_time: Estimate  # [s]
    mean_speed: Estimate  # [m/s]
    gates_passed: Estimate  # per drone and race


@dataclass(frozen=True)
class Evaluation:
    """What many races say of their pilots. Each quantity is over races; `docs/race-log.md` defines them."""

    track: str
    drones: int
    policy: str  # names of the pilots, joined by commas where they differ
    episodes: int
    seed: int
    success_rate: Estimate  # of drones: finished without a collision
    all_success_rate: Estimate  # of races: all drones did
    flying_lap_time: Estimate  # [s]
    winner_lap_time: Estimate  # flying lap of the winner [s]
    first_lap_time: Estimate  # [s]
    nominal_lap_time: Estimate  # length of each race's own polygon / mean speed [s]
    mean_speed: Estimate  # [m/s]
    top_speed: Estimate  # [m/s]
    collisions_per_race: Estimate
    missed_gates_per_race: Estimate
    overtakes_per_race: Estimate
    collisions_by_kind: dict[str, Estimate]
    pilots: tuple[PilotSummary, ...]

    def to_dict(self) -> dict[str, Any]:
        """The object that `cruise evaluate --json` prints."""
        plain = {name: getattr(self, name) for name in ("track", "drones", "policy", "episodes", "seed")}
        return plain | {name: getattr(self, name).to_dict() for name in MEASURED}


MEASURED = (
    "success_rate",
    "all_success_rate",
    "flying_lap_time",
    "winner_lap_time",
    "first_lap_time",
    "nominal_lap_time",
    "mean_speed",
    "top_speed",
    "collisions_per_race",
    "missed_gates_per_race",
    "overtakes_per_race",
)


def summarise(track: Track, team: Sequence[str], results: Sequence[RaceResult], seed: int) -> Evaluation:
    """Estimates over races; `team` names the pilot of every drone."""
    everyone = range(len(team))
    speed = _per_race(results, everyone, lambda drone: drone.mean_speed)
    return Evaluation(
        track=track.name,
        drones=len(team),
        policy=",".join(team) if len(set(team)) > 1 else team[0],
        episodes=len(results),
        seed=seed,
        success_rate=rate_estimate(_success(results, everyone), len(team)),
        all_success_rate=rate_estimate([float(all(d.finished for d in race.drones)) for race in results], 1),
        flying_lap_time=mean_estimate(_per_race(results, everyone, lambda drone: drone.flying_lap_time)),
        winner_lap_time=mean_estimate([_winner_lap(race) for race in results]),
        first_lap_time=mean_estimate(_per_race(results, everyone, lambda drone: drone.first_lap_time)),
        nominal_lap_time=mean_estimate([race.lap_length / v for race, v in zip(results, speed, strict=True)]),
        mean_speed=mean_estimate(speed),
        top_speed=mean_estimate(_per_race(results, everyone, lambda drone: drone.top_speed)),
        collisions_per_race=count_estimate([sum(race.collisions.values()) for race in results]),
        missed_gates_per_race=count_estimate([sum(d.missed_gates for d in race.drones) for race in results]),
        overtakes_per_race=count_estimate([race.overtakes for race in results]),
        collisions_by_kind={kind: count_estimate([race.collisions[kind] for race in results]) for kind in COLLISIONS},
        pilots=tuple(_pilot_summary(name, team, results) for name in dict.fromkeys(team)),
    )


def _pilot_summary(name: str, team: Sequence[str], results: Sequence[RaceResult]) -> PilotSummary:
    drones = [drone for drone, pilot in enumerate(team) if pilot == name]
    return PilotSummary(
        name=name,
        drones=len(drones),
        success_rate=rate_estimate(_success(results, drones), len(drones)),
        win_rate=rate_estimate([float(race.winner in drones) for race in results], 1),
        flying_lap_time=mean_estimate(_per_race(results, drones, lambda drone: drone.flying_lap_time)),
        mean_speed=mean_estimate(_per_race(results, drones, lambda drone: drone.mean_speed)),
        gates_passed=mean_estimate([float(np.mean([race.drones[d].gates_passed for d in drones])) for race in results]),
    )


def _success(results: Sequence[RaceResult], drones: Sequence[int]) -> list[float]:
    """Share of the drones that finished, race by race."""
    return [float(np.mean([race.drones[drone].finished for drone in drones])) for race in results]


def _winner_lap(race: RaceResult) -> float:
    """Its flying lap; NaN where nobody won."""
    return math.nan if race.winner == NOBODY else race.drones[race.winner].flying_lap_time


def _per_race(
    results: Sequence[RaceResult], drones: Sequence[int], quantity: Callable[[DroneResult], float]
) -> list[float]:
    """Mean of a quantity over the drones that finished, race by race; NaN where none did."""
    means = []
    for race in results:
        values = [quantity(race.drones[drone]) for drone in drones if race.drones[drone].finished]
        means.append(float(np.mean(values)) if values else math.nan)
    return means
