"""The search finds the best of a landscape that is known, and prefers success to speed."""

import math

import numpy as np
import pytest

from cruise.evaluation import planner_search
from cruise.evaluation.metrics import DroneResult, RaceResult
from cruise.evaluation.planner_search import (
    RANGES,
    Effort,
    Score,
    around,
    measure,
    ranges_of,
    score,
    search,
    style_at,
)
from cruise.pilots.se_ibr import Style
from cruise.pilots.se_ibr.settings import style_of
from cruise.presets import TRACKS, VEHICLES

RING = TRACKS["ring"]


def landscape(track, drones, styles, races, seed, vehicle=None):
    """Faster is better up to 5 m/s; then, or with a thin margin, drones are lost, the more the more there are."""
    scores = []
    for style in styles:
        lost = 0.1 * drones * max(0.0, style.speed - 5.0) + max(0.0, 0.3 - style.margin)
        lap = 60 / style.speed + abs(style.acceleration - 1.8) + abs(style.lead - 0.3) + style.margin
        scores.append(Score(1.0 - min(lost, 1.0), lap, style.speed))
    return scores


def test_finds_the_best_of_a_known_landscape(monkeypatch):
    monkeypatch.setattr(planner_search, "measure", landscape)
    effort = Effort(generations=6, candidates=64)
    stages = list(search(RING, effort, seed=1))
    assert [stage.stage for stage in stages] == list(range(1, effort.stages + 1))
    costs = [stage.best.cost for stage in stages[:6]]
    assert costs == sorted(costs, reverse=True)
    style, scores = stages[-1].best
    assert scores.keys() == {2, 3, 4}
    assert stages[-1].best.success > 0.97
    assert style.speed == pytest.approx(5.0, abs=0.4)
    assert style.acceleration == pytest.approx(1.8, abs=0.15)
    assert style.lead == pytest.approx(0.3, abs=0.1)


def test_success_comes_before_speed(monkeypatch):
    """In the finals one drone lost in a hundred counts more than any lap time."""

    def risky(track, drones, styles, races, seed, vehicle):
        found = landscape(track, drones, styles, races, seed)
        most = [1.0 if style.speed < 4.85 else 0.99 for style in styles]
        return [one._replace(success=min(one.success, limit)) for one, limit in zip(found, most, strict=True)]

    monkeypatch.setattr(planner_search, "measure", risky)
    best = list(search(RING, Effort(candidates=64), seed=0))[-1].best
    assert best.success == 1.0
    assert 4.5 < best.style.speed < 4.85


def test_generations_stay_in_range():
    rng = np.random.default_rng(0)
    points = around(rng.uniform(size=(40, len(RANGES))), list(range(40)), rng)
    assert points.shape == (40, len(RANGES))
    assert (points >= 0).all()
    assert (points <= 1).all()
    for point in (*points, np.zeros(len(RANGES)), np.ones(len(RANGES))):
        style = style_at(point)
        assert all(low <= getattr(style, name) <= high for name, (low, high) in RANGES.items())


@pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=lambda vehicle: vehicle.name)
def test_what_nobody_tuned_is_within_what_is_searched(vehicle):
    """So the search can do no worse than the style that a vehicle has without it."""
    usual = style_of("tuned", RING, vehicle)
    for name, (low, high) in ranges_of(vehicle).items():
        assert low <= getattr(usual, name) <= high, name


def drone(finished, laps, speed):
    """What the score reads of a drone's result."""
    lap = sum(laps) / len(laps)
    return DroneResult(finished, "", 16, 0, 3 * lap, 3 * lap, lap, laps, speed, speed)


def race_of(*drones):
    return RaceResult(drones, {}, 0, tuple(range(len(drones))), 60.0)


def test_score_counts_who_finished():
    races = [
        race_of(drone(True, (14.0, 15.0), 4.0), drone(False, (11.0,), 6.0)),
        race_of(drone(True, (15.0, 16.0), 4.4)),
    ]
    found = score(races)
    assert found == Score(success=2 / 3, flying_lap=15.0, mean_speed=pytest.approx(4.2))
    assert found.cost == pytest.approx(15.0 + 20.0 / 3)
    assert score([race_of(drone(False, (11.0,), 6.0))]).cost == math.inf


def test_each_style_is_flown_in_its_own_races(monkeypatch):
    """Races flown in batches no larger than is allowed; a race's speed is that of its style."""
    flown = []

    def race_with(track, drones, styles, races, seed, vehicle):
        flown.append(len(styles) * races)
        return [race_of(drone(True, (60.0 / style.speed,), style.speed)) for style in styles for _ in range(races)]

    monkeypatch.setattr(planner_search, "race_with", race_with)
    monkeypatch.setattr(planner_search, "race_result", lambda result: result)
    monkeypatch.setattr(planner_search, "DRONES_IN_BATCH", 25)
    speeds = [2.5, 4.0, 3.0, 5.0, 6.0]
    found = measure(RING, 4, [Style(speed, 1.7) for speed in speeds], 3, seed=0)
    assert flown == [6, 6, 3]
    assert [score.mean_speed for score in found] == pytest.approx(speeds)


def test_a_style_flies_its_own_races(monkeypatch):
    """Two laps take as long as the style's speed says."""
    styles = [Style(3.0, 1.7), Style(4.0, 1.7)]
    logs = planner_search.race_with(RING, 1, styles, 2, seed=0)
    top = [np.linalg.norm(log.velocity_w, axis=2).max() for log in logs]
    np.testing.assert_allclose(top, [3.0, 3.0, 4.0, 4.0], rtol=0.06)
    assert all(log.laps == 2 for log in logs)
