"""Finds how fast the SE-IBR planner can fly a track without losing anybody."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

from cruise.config import Track, Vehicle
from cruise.evaluation.matches import DRONES_IN_BATCH, race_env
from cruise.evaluation.metrics import RaceResult, race_result
from cruise.pilots.se_ibr import SeIbrPilot, Style
from cruise.pilots.se_ibr.settings import level_acceleration
from cruise.presets import VEHICLES
from cruise.racing.track_geometry import lap_length
from cruise.rollout import fly, team_rules
from cruise.storage.race_log import RaceLog
from cruise.storage.recorder import RaceInfo, race_logs

# What is searched, and where with the paper's vehicle.
RANGES = {"speed": (3.0, 6.5), "acceleration": (1.2, 2.4), "margin": (0.2, 0.6), "lead": (0.15, 0.8)}
FIELDS = (2, 3, 4)  # drones in the races of the finals
LOSS = 20.0  # what the share of drones that do not finish costs while searching, in seconds per lap
ELITE = 6  # of a generation, around which the next one is drawn
CAUTION = (1.0, 0.97, 0.94, 0.91)  # shares of a finalist's speed that enter the finals too
LEAST_SPREAD = 0.03  # of the next one, as a share of the range
DIGITS = 3
PAPER = VEHICLES["paper"]
# With rotors: shares of the speed that the velocity loop is meant for, and of the acceleration beside the weight.
SPEEDS, ACCELERATIONS = (0.5, 1.2), (0.25, 1.0)
LAPS = 2  # of a race: one from standing, one flying
SLOWEST = 0.36  # races end when a drone of this share of the velocity loop's speed would have finished


@dataclass(frozen=True)
class Effort:
    """How thoroughly to look. The default is minutes on two cores."""

    generations: int = 3
    candidates: int = 32  # of a generation
    races: int = 8  # of four drones, per candidate
    finalists: int = 2  # each enters with every share of `CAUTION`
    final_races: int = 32  # per style and number of drones

    @property
    def stages(self) -> int:
        """Of the search: generations and finals."""
        return self.generations + len(FIELDS)


class Score(NamedTuple):
    """How a style fares. Times and speeds of the drones that finished."""

    success: float  # share of drones that finished without a collision
    flying_lap: float  # mean [s]
    mean_speed: float  # [m/s]

    @property
    def cost(self) -> float:
        """What the search makes small: lap time, and a price for every loss."""
        return self.flying_lap + LOSS * (1.0 - self.success) if self.success > 0 else math.inf


class Candidate(NamedTuple):
    """A style and how it fared with each number of drones."""

    style: Style
    scores: dict[int, Score]

    @property
    def success(self) -> float:
        """The least over the numbers of drones."""
        return min(score.success for score in self.scores.values())

    @property
    def cost(self) -> float:
        """Mean over the numbers of drones."""
        return float(np.mean([score.cost for score in self.scores.values()]))


class Progress(NamedTuple):
    """A stage that is done."""

    stage: int  # from 1
    what: str
    best: Candidate


def ranges_of(vehicle: Vehicle) -> dict[str, tuple[float, float]]:
    """What is searched, and where."""
    if vehicle.flown_by == "cascade":
        return RANGES
    speed, acceleration = vehicle.tracking.speed, level_acceleration(vehicle)
    return RANGES | {
        "speed": (SPEEDS[0] * speed, SPEEDS[1] * speed),
        "acceleration": (ACCELERATIONS[0] * acceleration, ACCELERATIONS[1] * acceleration),
    }


def search(track: Track, effort: Effort, seed: int, vehicle: Vehicle = PAPER) -> Iterator[Progress]:
    """Generations of four drones each, then finals over the numbers of drones; the last best is the result.

    Candidates of the first generation fill the ranges evenly (Sobol), those of a later one are drawn around the best of
    the one before (cross-entropy method). The best enter the finals, and slower versions of them, for few races say
    little of rare losses; there nothing counts before success, then the flying lap.
    """
    seen: list[Candidate] = []
    points = qmc.Sobol(len(RANGES), seed=seed).random(effort.candidates)
    rng = np.random.default_rng(seed)
    for generation in range(effort.generations):
        styles = [style_at(point, vehicle) for point in points]
        scores = measure(track, 4, styles, effort.races, seed + generation, vehicle)
        tried = [Candidate(style, {4: score}) for style, score in zip(styles, scores, strict=True)]
        seen = sorted(seen + tried, key=lambda c: c.cost)
        what = f"{effort.candidates} styles x {effort.races} races of 4"
        yield Progress(generation + 1, what, seen[0])
        points = around(points, [c.cost for c in tried], rng)
    yield from _finals(track, seen[: effort.finalists], effort, seed + effort.generations, vehicle)


def _finals(
    track: Track, finalists: Sequence[Candidate], effort: Effort, seed: int, vehicle: Vehicle
) -> Iterator[Progress]:
    entered = [Candidate(slower(c.style, share), {}) for c in finalists for share in CAUTION]
    for number, drones in enumerate(FIELDS):
        scores = measure(track, drones, [c.style for c in entered], effort.final_races, seed + number, vehicle)
        for candidate, score in zip(entered, scores, strict=True):
            candidate.scores[drones] = score
        best = min(entered, key=lambda c: (-c.success, c.cost))
        what = f"{len(entered)} finalists x {effort.final_races} races of {drones}"
        yield Progress(effort.generations + number + 1, what, best)


def slower(style: Style, share: float) -> Style:
    """The style at a share of its speed."""
    return style._replace(speed=round(float(style.speed) * share, DIGITS))


def around(points: np.ndarray, costs: Sequence[float], rng: np.random.Generator) -> np.ndarray:
    """As many points again, normally distributed as the best of them are, within [0, 1]."""
    best = points[np.argsort(costs, kind="stable")[:ELITE]]
    spread = np.maximum(best.std(axis=0), LEAST_SPREAD)
    return np.clip(rng.normal(best.mean(axis=0), spread, points.shape), 0.0, 1.0)


def style_at(point: np.ndarray, vehicle: Vehicle = PAPER) -> Style:
    """The style at a point of the unit cube."""
    low, high = np.array(list(ranges_of(vehicle).values())).T
    values = np.round(low + point * (high - low), DIGITS).tolist()
    return Style(**dict(zip(RANGES, values, strict=True)))


def measure(
    track: Track, drones: int, styles: Sequence[Style], races: int, seed: int, vehicle: Vehicle = PAPER
) -> list[Score]:
    """Fly `races` with each style, as many at once as memory is meant for, and score them."""
    at_once = max(1, DRONES_IN_BATCH // (drones * races))
    if len(styles) > at_once:
        parts = styles[:at_once], styles[at_once:]
        return [one for part in parts for one in measure(track, drones, part, races, seed, vehicle)]
    results = [race_result(log) for log in race_with(track, drones, styles, races, seed, vehicle)]
    return [score(results[first : first + races]) for first in range(0, len(results), races)]


def race_with(
    track: Track, drones: int, styles: Sequence[Style], races: int, seed: int, vehicle: Vehicle = PAPER
) -> list[RaceLog]:
    """Races from random starts, the first `races` of them with the first style, and so on."""
    batch = len(styles) * races
    style = Style(*(jnp.repeat(jnp.array(column), races)[None] for column in zip(*styles, strict=True)))
    team = [SeIbrPilot(style).for_vehicle(vehicle)] * drones
    rules = team_rules(team, vehicle.collision_distance, track.gates_to_finish(LAPS), (batch,))
    steps = round(LAPS * lap_length(track.gates) / (SLOWEST * vehicle.tracking.speed) / vehicle.control_dt)
    flight = fly(race_env(track, drones, vehicle), team, rules, jax.random.key(seed), steps, (batch,))
    names, distance, aspect = [pilot.name for pilot in team], vehicle.collision_distance, vehicle.collision_aspect
    info = RaceInfo(track, LAPS, (vehicle.name,), distance, names, aspect)
    return race_logs(flight, info)


def score(results: Sequence[RaceResult]) -> Score:
    """What races say of the style they were flown in."""
    drones = [drone for result in results for drone in result.drones]
    finished = [drone for drone in drones if drone.finished]
    if not finished:
        return Score(0.0, math.inf, 0.0)
    laps, speeds = [d.flying_lap_time for d in finished], [d.mean_speed for d in finished]
    return Score(len(finished) / len(drones), float(np.mean(laps)), float(np.mean(speeds)))
