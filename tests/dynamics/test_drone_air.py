"""Air between drones, and the battery: laws of the single terms."""

import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Battery, Rotors
from cruise.dynamics.battery import AIR_DENSITY, discharge, ideal_power, supply
from cruise.dynamics.downwash import core_length, induced_air_w, jet_speed

ROTORS = Rotors(offset=(0.075, 0.1), torque_ratio=0.022, max_thrust=6.0, radius=0.0635)
THRUST = 7.4
CORE = core_length(ROTORS)


@pytest.mark.parametrize("along", [0.2, 1.0, 3.0, 10.0])
def test_the_jets_momentum_flux_is_the_thrust_at_every_distance(along: float) -> None:
    """Integral of rho U^2 over a plane below the drone."""
    r = np.linspace(0, 40, 400_001) * along / 10
    thrust, down = (jnp.full(r.shape, value) for value in (THRUST, along))
    speed = np.asarray(jet_speed(thrust, down, jnp.asarray(r**2), CORE), np.float64)
    flux = AIR_DENSITY * np.trapezoid(speed**2 * 2 * np.pi * r, r)
    assert flux == pytest.approx(THRUST, rel=1e-3)


def test_the_jet_is_fastest_where_momentum_theory_says_and_decays_with_distance() -> None:
    def on_axis(along: float) -> float:
        return float(jet_speed(jnp.asarray(THRUST), jnp.asarray(along), jnp.asarray(0.0), CORE))

    wake = np.sqrt(2 * THRUST / (AIR_DENSITY * 4 * np.pi * ROTORS.radius**2))
    assert on_axis(0.3) == pytest.approx(wake, rel=1e-5)
    assert on_axis(4 * CORE) == pytest.approx(wake / 4, rel=1e-5)
    half = jet_speed(jnp.asarray(THRUST), jnp.asarray(4.0), jnp.asarray((0.094 * 4.0) ** 2), CORE)
    assert float(half) == pytest.approx(on_axis(4.0) / 2, rel=1e-4)
    assert on_axis(-0.5) == 0.0


def field(places: np.ndarray, airborne: list[bool], axes: np.ndarray | None = None) -> np.ndarray:
    up = np.repeat([[0.0], [0.0], [1.0]], places.shape[1], axis=1) if axes is None else axes
    thrust = np.full(places.shape[1], THRUST)
    arguments = (jnp.asarray(x, jnp.float32) for x in (places, up, thrust))
    return np.asarray(induced_air_w(ROTORS, *arguments, jnp.asarray(airborne)))


STACK = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 0.0], [3.0, 2.0, 3.0]])  # one above the other, one far away


def test_only_the_drone_below_feels_the_one_above() -> None:
    air = field(STACK, [True, True, True])
    assert air[2, 1] < -5
    assert np.abs(air[:, 0]).max() == 0
    assert np.abs(air[:, 2]).max() < 0.01


def test_who_has_left_the_air_moves_none_of_it() -> None:
    assert np.abs(field(STACK, [False, True, True])[:, 1]).max() < 0.01


def test_jets_add_up_and_point_along_the_thrust() -> None:
    places = np.array([[0.0, 0.2, 0.1], [0.0, 0.0, 0.0], [3.0, 3.0, 1.0]])
    together = field(places, [True] * 3)
    apart = field(places, [True, False, True]) + field(places, [False, True, True])
    np.testing.assert_allclose(together[:, 2], apart[:, 2], rtol=1e-5)
    lean = np.array([np.sin(0.4), 0.0, np.cos(0.4)])
    axes = np.stack([lean, [0, 0, 1], [0, 0, 1]], axis=1)
    below = np.stack([[0.0, 0.0, 5.0], 0.0 - 2.0 * lean + [0.0, 0.0, 5.0], [50.0, 0.0, 5.0]], axis=1)
    air = field(below, [True] * 3, axes)[:, 1]
    np.testing.assert_allclose(air / np.linalg.norm(air), -lean, atol=1e-5)


BATTERY = Battery()


def test_ideal_power_is_that_of_momentum_theory() -> None:
    """P = T v_i with v_i = sqrt(T / 2 rho A), rotor by rotor."""
    thrusts = np.array([1.0, 2.0, 0.0, 4.0])
    induced = np.sqrt(thrusts / (2 * AIR_DENSITY * np.pi * 0.0635**2))
    assert float(ideal_power(ROTORS, jnp.asarray(thrusts))) == pytest.approx((thrusts * induced).sum(), rel=1e-5)


def test_voltage_sags_with_the_load_and_with_the_charge() -> None:
    loads, charges = np.meshgrid(np.linspace(0, 400, 30), np.linspace(0, 1, 20), indexing="ij")
    voltage = np.asarray(supply(BATTERY, jnp.asarray(loads), jnp.asarray(charges)).voltage)
    assert (np.diff(voltage, axis=0) < 0).all()
    assert (np.diff(voltage, axis=1) > 0).all()
    assert voltage[0, -1] == pytest.approx(BATTERY.full_voltage)
    assert voltage[0, 0] == pytest.approx(BATTERY.empty_voltage)


def test_the_battery_obeys_ohm_and_watt() -> None:
    now = supply(BATTERY, jnp.asarray(200.0), jnp.asarray(0.6))
    rest = BATTERY.empty_voltage + 0.6 * (BATTERY.full_voltage - BATTERY.empty_voltage)
    assert float(now.voltage) == pytest.approx(rest - BATTERY.resistance * float(now.current), rel=1e-5)
    assert float(now.voltage * now.current) == pytest.approx(200.0 / BATTERY.efficiency, rel=1e-4)
    assert float(now.thrust_share) == pytest.approx((float(now.voltage) / BATTERY.full_voltage) ** 2, rel=1e-5)


def test_no_load_is_more_than_the_battery_can_give() -> None:
    """Beyond V^2 / 4 R it gives that, and finite numbers."""
    now = supply(BATTERY, jnp.asarray(1e6), jnp.asarray(1.0))
    assert float(now.voltage) == pytest.approx(BATTERY.full_voltage / 2)


def test_charge_falls_to_nothing_and_no_further() -> None:
    charge = jnp.asarray(1.0)
    assert float(discharge(BATTERY, charge, jnp.asarray(10.0), 60.0)) == pytest.approx(1 - 600 / BATTERY.capacity)
    assert float(discharge(BATTERY, charge, jnp.asarray(1e3), 60.0)) == 0.0
