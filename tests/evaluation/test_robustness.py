"""Robustness: every deviation at every strength, each alone, flown and logged as it was."""

import dataclasses
import math

import numpy as np
import pytest

from cruise.config import Randomisation
from cruise.errors import CruiseError
from cruise.evaluation.matches import make_match, run_races
from cruise.evaluation.robustness import (
    KINDS,
    SENSED_KINDS,
    STRENGTHS,
    _by_cell,
    _sensors_by_cell,
    cells,
    measure_robustness,
    sensing_cells,
)
from cruise.presets import RANDOMISATION, TRACKS
from cruise.storage.race_log import EventKind

RING = TRACKS["ring"]


def test_every_field_has_a_kind_and_every_cell_is_that_kind_alone() -> None:
    full = RANDOMISATION["racer"]
    fields = {name for name, value in dataclasses.asdict(full).items() if value}
    assert {name for kind in KINDS for name in kind.fields} == fields
    table = cells(full)
    signed = sum(kind.signed for kind in KINDS)
    assert len(table) == 1 + len(STRENGTHS) * (len(KINDS) + signed)
    chance, offset = _by_cell(full, table)
    for place, cell in enumerate(table):
        changed = {name for part in (chance, offset) for name, values in part.items() if values[place]}
        assert changed == ((set(cell.kind.fields) or fields) if cell.strength else set())
    heavier = next(i for i, cell in enumerate(table) if cell.kind.name == "mass" and cell.strength == 2)
    np.testing.assert_allclose([offset["mass_spread"][heavier], table[heavier].value], [0.2, 20.0])


def test_every_way_not_to_know_the_race_has_its_own_number_scaled() -> None:
    full = RANDOMISATION["racer"]
    table = sensing_cells(full, drones=2)
    assert len(table) == len(STRENGTHS) * len(SENSED_KINDS)
    assert len(sensing_cells(full, drones=1)) == len(table) - len(STRENGTHS)  # nobody there to be told of
    numbers = _sensors_by_cell(table, 0.02).numbers
    found = {cell.kind.name: [] for cell in table}
    for place, cell in enumerate(table):
        found[cell.kind.name].append((numbers["bias"][place], numbers["latency"][place], numbers["radio_delay"][place]))
    np.testing.assert_allclose([x for x, _, _ in found["camera, velocity biased, up to"]], [0.15, 0.3, 0.45, 0.6])
    assert [x for _, x, _ in found["camera, late by"]] == [2, 5, 8, 10]
    assert [x for _, _, x in found["opponents told by radio, late by"]] == [5, 10, 15, 20]
    chance, _ = _by_cell(full, table)
    assert {name for name, values in chance.items() if values[0]} == {"gate_shift", "gate_turn"}


def test_a_heavier_drone_laps_more_slowly_and_nothing_is_as_the_vehicle_says() -> None:
    """A chaser whose thrust is limited: its laps at each mass, and those of a plain evaluation."""
    match = make_match(RING, 1, "chaser", laps=1, vehicle="racer")
    points = list(measure_robustness(match, 2, seed=3))
    assert len(points) == len(cells(RANDOMISATION["racer"])) + len(sensing_cells(RANDOMISATION["racer"], 1))
    assert points[0].cell.strength == 0
    assert all(0 <= point.success_rate.mean <= 1 for point in points)
    assert points[0].success_rate.mean == 1.0
    assert all(math.isnan(point.flying_lap_time.mean) for point in points)  # one lap: from standing
    with pytest.raises(CruiseError, match="races must be from 1 to 10000, got 0"):
        next(measure_robustness(match, 0, seed=0))


def test_a_randomised_race_is_logged_with_its_own_gates() -> None:
    """Crossings lie in the planes of the gates that the log shows, which are not those of the track."""
    match = make_match(RING, 2, "chaser", laps=1, vehicle="racer", randomise=1.0)
    logs = list(run_races(match, 3, seed=1))
    usual = np.array([gate.position_w for gate in RING.gates])
    shifts = np.array([log.gate_position - usual for log in logs])
    assert 0.05 < np.abs(shifts).max() <= 0.1001
    assert len({tuple(shift.ravel()) for shift in shifts}) == 3
    for log in logs:
        crossings = log.event_kind == EventKind.CROSSING
        assert crossings.sum() >= 6
        events = zip(log.event_time[crossings], log.event_drone[crossings], log.event_gate[crossings], strict=True)
        for time, drone, gate in events:
            where = [np.interp(time, log.time, log.position_w[:, drone, axis]) for axis in range(2)]
            normal = np.array([np.cos(log.gate_yaw[gate]), np.sin(log.gate_yaw[gate])])
            assert abs(normal @ (where - log.gate_position[gate, :2])) < 1e-3


def test_randomise_is_a_share_of_what_the_vehicle_may_differ_by() -> None:
    match = make_match(RING, 1, "chaser", vehicle="racer", randomise=0.5)
    assert match.randomisation.mass_spread == pytest.approx(0.5 * RANDOMISATION["racer"].mass_spread)
    assert make_match(RING, 1, "chaser").randomisation == Randomisation()
    with pytest.raises(CruiseError, match=r"randomise must be from 0 to 2.0, got 3"):
        make_match(RING, 1, "chaser", randomise=3.0)
