"""Time-optimal laps: known answers, and what every one of them must satisfy."""

import functools
import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from cruise.config import Drag, Gate, Pole, Track
from cruise.errors import CruiseError
from cruise.geometry import beyond_opening, heading_of, tilt_of, to_gate
from cruise.limit import guess
from cruise.limit.lap import Options, find_limit
from cruise.limit.models import ATTITUDE, POSITION, VELOCITY, make_model, point_mass
from cruise.limit.transcription import Problem
from cruise.presets import TRACKS, VEHICLES
from cruise.vehicles import with_thrust_to_weight
from tests.racing.obstacles import distance, pole_in_the_way, wall_in_the_way, with_solids


@functools.cache
def limit(track="ring", vehicle="racer", standing_laps=0):
    return find_limit(TRACKS[track], VEHICLES[vehicle], Options(standing_laps=standing_laps))


def ideal(thrust_to_weight):
    """The quadrotor of the published prototypes: thrust and rates lag by 0.03 s, no drag."""
    vehicle = with_thrust_to_weight(VEHICLES["racer"], thrust_to_weight, "ideal", "")
    rotors = replace(vehicle.airframe.rotors, saturate=False, time_constant=0.03)
    rates = replace(vehicle.airframe.rates, time_constant=0.03)
    return replace(vehicle, airframe=replace(vehicle.airframe, rotors=rotors, rates=rates, drag=Drag()))


@pytest.mark.parametrize(
    ("track", "ratio", "flying", "standing"),
    [
        ("ring", 2.0, 4.63, 4.92),
        ("ring", 3.3, 3.44, 3.71),
        ("figure-eight", 2.0, 5.83, 5.74),
        ("figure-eight", 3.3, 4.35, 4.33),
    ],
)
def test_laps_of_an_independent_solution(track, ratio, flying, standing):
    """Computed before by another transcription (trapezoidal, other code): within half a per cent."""
    for laps, expected in ((0, flying), (1, standing)):
        found = find_limit(TRACKS[track], ideal(ratio), Options(standing_laps=laps))
        assert found.lap.time == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize(("track", "lap"), [("ring", 2.76), ("figure-eight", 3.50)])
def test_laps_of_a_point_mass(track, lap):
    problem = Problem(TRACKS[track], point_mass(5 * 9.81, 9.81))
    assert problem.solve(guess.line(problem, 4.0, 20)).time == pytest.approx(lap, rel=0.005)


def test_a_circle_is_flown_at_the_speed_that_the_thrust_turns():
    """Through the middle of 24 gates on a circle: v^2 / R is what the thrust leaves beside the weight."""
    thrust, gravity, radius, count = 20.0, 9.81, 10.0, 24
    angles = 2 * np.pi * np.arange(count) / count
    gates = tuple(Gate((radius * np.cos(a), radius * np.sin(a), 5.0), a + np.pi / 2) for a in angles)
    track = Track("circle", gates, bounds_low=(-20.0, -20.0, 0.0), bounds_high=(20.0, 20.0, 20.0))
    problem = Problem(track, point_mass(thrust, gravity), margin=1.0 - 1e-3)
    speed = math.sqrt(radius * math.sqrt(thrust**2 - gravity**2))
    lap = problem.solve(guess.line(problem, 6.0, 5))
    assert lap.time == pytest.approx(2 * math.pi * radius / speed, rel=0.003)
    np.testing.assert_allclose(np.linalg.norm(lap.state[:, VELOCITY], axis=1), speed, rtol=0.01)


def test_more_thrust_is_faster_and_drag_is_slower():
    racer, five = limit(), limit(vehicle="racer-5")
    assert five.lap.time < racer.lap.time
    free = replace(VEHICLES["racer"], airframe=replace(VEHICLES["racer"].airframe, drag=Drag()))
    assert find_limit(TRACKS["ring"], free).lap.time < racer.lap.time


def test_no_vehicle_beats_the_point_mass_of_its_thrust():
    for track in ("ring", "figure-eight"):
        problem = Problem(TRACKS[track], point_mass(3.3 * 9.81, 9.81))
        fastest = problem.solve(guess.line(problem, 4.0, 20)).time
        assert fastest < limit(track).lap.time < 1.05 * fastest


@pytest.mark.parametrize("track", ["ring", "figure-eight"])
def test_a_finer_grid_changes_nothing(track):
    fine = find_limit(TRACKS[track], VEHICLES["racer"], Options(steps=40))
    assert fine.lap.time == pytest.approx(limit(track).lap.time, rel=1e-3)


@pytest.mark.parametrize(("track", "laps"), [("ring", 0), ("figure-eight", 0), ("ring", 1), ("figure-eight", 2)])
def test_every_gate_is_passed_inside_with_the_margin_and_forward(track, laps):
    found = limit(track, standing_laps=laps)
    gates, steps = TRACKS[track].gates, found.lap.steps
    assert len(found.lap.duration) == len(gates) * max(laps, 1)
    for s in range(1, len(found.lap.duration) + 1):
        gate, state = gates[s % len(gates)], found.lap.state[s * steps]
        offset = state[POSITION] - gate.position_w
        normal = np.array([math.cos(gate.yaw), math.sin(gate.yaw), 0])
        assert offset @ normal == pytest.approx(0, abs=1e-5)
        assert abs(normal[0] * offset[1] - normal[1] * offset[0]) < 0.75 + 1e-5
        assert abs(offset[2]) < 0.75 + 1e-5
        assert state[VELOCITY] @ normal > 0.19
    assert found.frames_struck == ()


@pytest.mark.parametrize("laps", [0, 1])
def test_the_flight_obeys_the_vehicle(laps):
    vehicle, lap = VEHICLES["racer"], limit(standing_laps=laps).lap
    rotors, highest = vehicle.airframe.rotors, np.array(vehicle.airframe.rates.highest)
    for thrusts in (lap.state[:, 13:], lap.control):
        assert (thrusts >= -1e-5).all()
        assert (thrusts <= rotors.max_thrust + 1e-5).all()
    assert (np.abs(lap.state[:, 10:13]) <= 1.5 * highest).all()  # the lag of rotors lets rates overshoot commands
    model = make_model(vehicle)
    symbols = ca.SX.sym("x", model.state_size), ca.SX.sym("u", 4)
    commanded = ca.Function("c", symbols, [model.path(*symbols)]).map(len(lap.control))(lap.state[:-1].T, lap.control.T)
    assert (np.abs(np.array(commanded)) <= 1 + 1e-5).all()
    np.testing.assert_allclose(np.linalg.norm(lap.state[:, ATTITUDE], axis=1), 1, atol=1e-6)
    if laps:
        start = make_model(vehicle).hover
        start[POSITION] = TRACKS["ring"].gates[0].position_w
        np.testing.assert_allclose(lap.state[0], start, atol=1e-6)
    else:
        first, last = lap.state[0].copy(), lap.state[-1].copy()
        last[ATTITUDE] *= np.sign(first[ATTITUDE] @ last[ATTITUDE])
        np.testing.assert_allclose(first, last, atol=1e-5)


def test_laps_from_standing_approach_the_flying_lap():
    first, second, third = limit(standing_laps=3).lap_times
    assert first > second > third  # the end is free: nothing behind the last gate counts
    assert second == pytest.approx(limit().lap.time, rel=0.01)


def test_what_is_said_of_a_lap_adds_up():
    found = limit()
    assert found.lap_times == (pytest.approx(found.lap.time),)
    path = np.linalg.norm(np.diff(found.lap.state[:, POSITION], axis=0), axis=1).sum()
    assert found.mean_speed == pytest.approx(path / found.lap.time, rel=0.005)
    polygon = 5 * math.hypot(2 * 10 * math.sin(math.pi / 5), 0.8)  # four of five legs climb or sink by 1 m
    assert found.nominal_speed == pytest.approx(polygon / found.lap.time, rel=0.01)
    assert found.mean_speed < found.top_speed < 1.2 * found.mean_speed


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"margin": 1.0}, "margin must be from 0 to less than 1 m, half the smallest opening, not 1.0"),
        ({"margin": -0.1}, "margin must be from 0"),
        ({"margin": math.nan}, "margin must be from 0"),
        ({"standing_laps": 11}, "laps from standing must be from 1 to 10, not 11"),
        ({"steps": 1}, "steps must be from 5 to 200, not 1"),
        ({"largest_change": 0.2}, "the largest change of an action says nothing of 'racer'"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(options, told):
    with pytest.raises(CruiseError, match="^" + told):
        find_limit(TRACKS["ring"], VEHICLES["racer"], Options(**options))


def test_a_frame_in_the_way_is_noticed():
    """One more gate is put where the line runs, its edge right on it; and one whose opening it goes through."""
    found = limit()
    middle = found.lap.state[found.lap.steps // 2]
    along = math.atan2(middle[4], middle[3])
    aside = np.array([-math.sin(along), math.cos(along), 0.0])

    def struck(offset):
        gate = Gate(tuple(middle[POSITION] + offset * aside), along)
        return replace(found, track=replace(TRACKS["ring"], gates=(*TRACKS["ring"].gates, gate))).frames_struck

    assert struck(0.0) == struck(0.9) == struck(1.4) == ()
    assert struck(1.15) == struck(-1.15) == (5,)


def position_on(lap, times):
    """Between the states a cubic, as a vehicle flies."""
    line = CubicHermiteSpline(lap.clock, lap.state[:, POSITION], lap.state[:, VELOCITY])
    return line(times)


@pytest.mark.parametrize("standing_laps", [0, 1])
def test_solids_in_the_way_are_passed_with_the_margin(standing_laps):
    ring, free = TRACKS["ring"], limit(standing_laps=standing_laps)
    solids = pole_in_the_way(ring, 0), wall_in_the_way(ring, 3)
    found = find_limit(with_solids(ring, *solids), VEHICLES["racer"], Options(standing_laps=standing_laps))
    line = position_on(found.lap, np.linspace(0, found.lap.time, 5000))
    for solid in solids:
        assert distance(solid, line).min() > 0.8 * 0.25
    assert free.lap.time < found.lap.time < 1.2 * free.lap.time
    assert found.solids_struck == ()
    struck = replace(free, track=with_solids(ring, Pole((*free.lap.state[30, :2], 0.0), 10.0, 0.1), *solids[1:]))
    assert 0 in struck.solids_struck


def test_tilted_and_round_gates_are_passed_inside_along_their_normals():
    gates = list(TRACKS["ring"].gates)
    gates[1] = replace(gates[1], pitch=0.8, shape="round")
    gates[2] = replace(gates[2], roll=0.5, pitch=-0.5)
    found = find_limit(replace(TRACKS["ring"], gates=tuple(gates)), VEHICLES["racer"])
    for k in (1, 2):
        gate, state = gates[k], found.lap.state[k * found.lap.steps]
        frame = heading_of(gate.yaw), tilt_of(gate.roll, gate.pitch)
        forward, left, up = to_gate(frame[0], state[POSITION] - gate.position_w, frame[1])
        assert forward == pytest.approx(0, abs=1e-5)
        assert beyond_opening(left, up, 1.0, 1.0, True if gate.shape == "round" else None) < -0.25 + 1e-5
        assert to_gate(frame[0], state[VELOCITY], frame[1])[0] > 0.19


def test_a_gate_that_follows_itself_is_refused_in_one_line():
    one = replace(TRACKS["ring"], gates=TRACKS["ring"].gates[:1])
    for vehicle in ("racer", "paper"):
        with pytest.raises(CruiseError, match=r"^ring has a gate that follows itself in one place: .*opening$"):
            find_limit(one, VEHICLES[vehicle])
