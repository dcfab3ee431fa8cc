"""The numbers of a vehicle are found again in what another simulator flew; what a flight does not tell is said."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.identification import TRUE, measured, started, truth
from cruise.cli.main import main
from cruise.dynamics.rotors import places
from cruise.errors import CruiseError
from cruise.identify import FlightLog, identify
from cruise.identify.grid import prepare
from cruise.identify.model import Body, Numbers, motor_thrust_per_mass, rate_residuals, yaw_residuals
from cruise.vehicles import VEHICLES, load_vehicle, save_vehicle
from examples.fly_to_identify import COLUMNS, fly

START = started("mujoco")


@pytest.fixture(scope="module")
def rows():
    return fly(TRUE, "mujoco", 10.0)


@pytest.fixture(scope="module")
def found(rows):
    return identify([measured(rows, seed=1)], START)


def test_the_numbers_that_flew_are_found_again_from_a_noisy_log(found):
    """With noise, lost samples, and commands on a clock of their own."""
    real = truth(TRUE)
    real["vertical_drag"] = real["horizontal_drag"]  # MuJoCo's air is alike along all axes
    for name, value in real.items():
        one = found.numbers[name]
        assert one.told, name
        assert one.value == pytest.approx(value, rel=0.05), name
        assert one.low < value < one.high, name
    assert found.missing == []
    assert found.numbers["drift"].value == pytest.approx(-2e-4, abs=1e-4)


def log_of(rows, **changes):
    """What was logged, without noise, with some signals changed."""
    log = measured(rows, seed=2)
    return replace(log, **changes)


def test_what_is_not_logged_is_not_told_and_the_manoeuvre_is_said(rows):
    found = identify([log_of(rows, velocity=None, motors=None)], START)
    missing = {line.split(" is not identified: ")[0] for line in found.missing}
    assert {"thrust", "horizontal drag", "vertical drag", "torque ratio"} <= missing
    assert not {"rotor lag", "rate lag"} & missing
    assert "yaw rate up and down, with the four motors in the log" in found.missing[-1]
    assert found.numbers["thrust"].value == START.agility


def test_a_hover_tells_no_drag_and_no_lag(rows):
    """Steady flight holds nothing of how it changes."""
    log = measured(rows, seed=3)
    chance = np.random.default_rng(0)
    still = {
        "rates": np.where(np.isfinite(log.rates), 0.05 * chance.standard_normal(log.rates.shape), np.nan),
        "rate_command": np.where(
            np.isfinite(log.rate_command), 1e-3 * chance.standard_normal(log.rate_command.shape), np.nan
        ),
        "velocity": np.where(np.isfinite(log.velocity), 0.05 * chance.standard_normal(log.velocity.shape), np.nan),
        "attitude": np.where(np.isfinite(log.attitude), np.eye(4)[:, :1], np.nan),
        "throttle": np.where(np.isfinite(log.throttle), 0.303, np.nan),
    }
    found = identify([replace(log, **still, motors=None)], START)
    missing = {line.split(" is not identified")[0] for line in found.missing}
    assert {"rotor lag", "rate lag", "horizontal drag", "vertical drag"} <= missing
    assert found.numbers["horizontal_drag"].value == pytest.approx(0.4 / 0.752)


def test_true_numbers_leave_nothing(rows):
    """The model is that of the rate loop, sampled as it is; MuJoCo's air slows turning too."""
    log = FlightLog("clean", rows[:, 0], rows[:, 1], rows[:, 2:5].T, rows[:, 5:8].T)
    flight = prepare(log, START)
    real = truth(TRUE)
    true = Numbers(
        real["thrust"], 0.0, real["rotor_lag"], real["rate_lag"], real["delay"], 0.0, 0.75, 0.0, 0.3, 0.3, 0.02
    )
    wrong = true._replace(rate_lag=0.06)
    rest, worse = (float(np.sqrt((rate_residuals(flight, one)[:2] ** 2).mean())) for one in (true, wrong))
    assert rest < 0.05 < 3 * rest < worse


def test_drag_of_single_rotors_yaws_by_their_arms(rows):
    """By cross products: where rotors go by speed, each is pulled back by its own share of the drag."""
    flight = prepare(measured(rows, seed=0), TRUE)
    numbers = Numbers(30.0, 0.0, 0.03, 0.04, 0.0, 0.0, 0.0, 0.0, 0.4, 0.0, 0.016)
    arms = places(TRUE.airframe.rotors)
    body = Body(TRUE.mass, TRUE.inertia, tuple(arms))
    with_drag, without = (
        yaw_residuals(flight, numbers._replace(horizontal_drag=drag), True, body) for drag in (0.4, 0.0)
    )
    velocity_b = np.einsum("wbn,wn->nb", flight.rotation[:, :, :-1], flight.velocity[:, :-1])
    torque = np.zeros(len(velocity_b))
    for arm, thrust in zip(arms, motor_thrust_per_mass(flight, numbers, True), strict=True):
        share = np.sqrt(thrust / (flight.gravity / 4))[:, None]
        torque += np.cross(arm, -TRUE.mass * 0.4 / 4 * share * velocity_b)[:, 2]
    yawed = np.concatenate([[0.0], np.cumsum(torque) * flight.dt]) / TRUE.inertia[2]
    samples = flight.measured_rates
    pushed = np.interp(samples.times, flight.edges, yawed)
    mean = (pushed * samples.there).sum(axis=1) / np.maximum(samples.there.sum(axis=1), 1)
    expected = -(pushed - mean[:, None]) * samples.there
    assert np.abs(expected).max() > 0.01
    np.testing.assert_allclose((with_drag - without)[0], expected, atol=1e-9)


def test_who_is_always_at_its_limits_is_told_so(rows):
    weak = replace(START, airframe=replace(START.airframe, rotors=replace(START.airframe.rotors, max_thrust=2.0)))
    with pytest.raises(CruiseError, match="rotors are at their limits in 100 % of the seconds: fly more gently"):
        identify([log_of(rows, motors=None)], weak)
    with pytest.raises(CruiseError, match="vehicle 'paper' has no rotors: there is nothing to identify"):
        identify([log_of(rows)], VEHICLES["paper"])


def test_the_command_writes_a_vehicle_with_its_intervals(rows, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    save_vehicle(replace(START, name="mine"), "mine.toml")
    np.savetxt("flight.csv", rows, delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.6g")
    assert main(["identify", "flight.csv", "--start", "mine.toml", "--out", "mine.toml"]) == 0
    output = capsys.readouterr().out
    assert "rotor lag" in output
    assert output.endswith("vehicle   mine.toml\n")
    mine, text = load_vehicle("mine.toml"), Path("mine.toml").read_text()
    assert mine.agility == pytest.approx(TRUE.agility, rel=0.02)
    assert mine.airframe.delay == pytest.approx(0.032, rel=0.06)
    assert mine.source == "identified from flight.csv, from mine"
    assert text.count("# identified: ") == 7
    Path("bad.csv").write_text("time_s\n")
    for arguments, message in (
        (
            ["bad.csv", "--out", "x.toml"],
            "bad.csv: no column 'throttle': throttle is told by throttle; there are time_s",
        ),
        (["flight.csv", "--out", "racer.toml"], "racer.toml: 'racer' is a built-in vehicle: choose another name"),
        (["flight.csv", "--out", "x.json"], "--out must name a .toml file, got 'x.json'"),
        (["none.csv", "--out", "x.toml"], "none.csv: no such flight log"),
    ):
        assert main(["identify", *arguments, "--start", "mine.toml"]) == 2
        assert capsys.readouterr().err == f"error: {message}\n"
    assert not Path("x.toml").exists()
