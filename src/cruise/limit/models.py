"""Vehicles as differential equations in CasADi, for the optimiser: those of `cruise.dynamics`, on symbols.

Three are told apart: a point mass whose thrust points anywhere at once; a body whose rates are commanded; and a body
with four rotors, whose limits and lag bind one by one.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from cruise.config import Airframe, Vehicle
from cruise.dynamics.parameters import physics_of
from cruise.dynamics.rigid_body import Wrench, euler_equation, make_free_derivative
from cruise.dynamics.rotors import wrench_of
from cruise.dynamics.types import FreeBody
from cruise.limit.symbols import flat, parts, smooth

POSITION, VELOCITY, ATTITUDE, RATES = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
LEAST_LAG = 1e-3  # of what does not lag: a state needs an equation [s]
SMOOTH = smooth(root=1e-6)  # of a squared speed, whose root is quadratic drag's [m^2/s^2]
Range = tuple[np.ndarray, np.ndarray]  # lowest and highest


@dataclass(frozen=True)
class Model:
    """x' = derivative(x, u), with u in a box and more inequalities that hold along the path."""

    name: str
    state_size: int
    control: Range
    derivative: Callable[[ca.SX, ca.SX], ca.SX]
    hover: np.ndarray  # state at the origin at rest, heading 0
    lift: np.ndarray  # control that hovers
    state: Range  # bounds of the state beside those of the track
    path: Callable[[ca.SX, ca.SX], ca.SX] | None = None  # within `path_range`
    path_range: Range = field(default_factory=lambda: (np.zeros(0), np.zeros(0)))
    has_attitude: bool = True


def point_mass(thrust: float, gravity: float, drag: float = 0.0) -> Model:
    """A body with v' = a - g e_z - drag v and |a| <= thrust [m/s^2]: no vehicle with this thrust is faster."""

    def derivative(x: ca.SX, u: ca.SX) -> ca.SX:
        return ca.vertcat(x[VELOCITY], u - ca.vertcat(0, 0, gravity) - drag * x[VELOCITY])

    return Model(
        name="point mass",
        state_size=6,
        control=(np.full(3, -thrust), np.full(3, thrust)),
        derivative=derivative,
        hover=np.zeros(6),
        lift=np.array([0.0, 0.0, gravity]),
        state=_free(6),
        path=lambda x, u: ca.dot(u, u) / thrust**2,
        path_range=(np.zeros(1), np.ones(1)),
        has_attitude=False,
    )


def make_model(vehicle: Vehicle) -> Model:
    """The model of a vehicle that is flown by thrust and body rates."""
    assert vehicle.airframe is not None
    return _rotor_driven(vehicle) if vehicle.airframe.rotors.saturate else _rate_driven(vehicle)


def _rate_driven(vehicle: Vehicle) -> Model:
    """Rates and collective thrust follow what is commanded with a lag each. State p, v, q, rates, c; control c, rates.

    So they do in the simulator where rotors have no limits, but for the rotors' lag in the way of the rates, too.
    """
    airframe = _airframe(vehicle)
    thrust_lag, rates_lag = _lag(airframe.rotors.time_constant), _lag(airframe.rates.time_constant)
    thrust = vehicle.agility
    highest = np.array(airframe.rates.highest)

    def derivative(x: ca.SX, u: ca.SX) -> ca.SX:
        # The rate loop's torque in Euler's equation leaves this lag of the rates, whatever the inertia.
        rate = _motion(vehicle, x, Wrench(vehicle.mass * x[13], (0.0, 0.0, 0.0)))
        return flat([*rate[:3], (u[1:4] - x[RATES]) / rates_lag, (u[0] - x[13]) / thrust_lag])

    low, high = _free(14)
    low[13], high[13] = 0.0, thrust
    return Model(
        name="body rates",
        state_size=14,
        control=(np.array([0.0, *-highest]), np.array([thrust, *highest])),
        derivative=derivative,
        hover=np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, vehicle.gravity], float),
        lift=np.array([vehicle.gravity, 0, 0, 0]),
        state=(low, high),
    )


def _rotor_driven(vehicle: Vehicle) -> Model:
    """State p, v, q, rates, four thrusts [N]; control: the thrusts that the rotors head for, or have where none lags.

    A rate loop may ask for no other torque than J (omega_c - omega) / t + omega x J omega with omega_c within its
    limits: that is the inequality.
    """
    airframe = _airframe(vehicle)
    rotors, rates = airframe.rotors, airframe.rates
    highest, lags = ca.DM(list(rates.highest)), rotors.time_constant > 0

    def derivative(x: ca.SX, u: ca.SX) -> ca.SX:
        rate = _motion(vehicle, x, wrench_of(rotors, ca.vertsplit(x[13:17] if lags else u), SMOOTH))
        if not lags:
            return flat([*rate])
        return flat([*rate, (u - x[13:17]) / _lag(rotors.time_constant)])

    def commanded_rates(x: ca.SX, u: ca.SX) -> ca.SX:
        (omega,) = parts(x, RATES)
        torque = wrench_of(rotors, ca.vertsplit(u), SMOOTH).body_torque_b
        return (x[RATES] + rates.time_constant * flat([euler_equation(vehicle.inertia, omega, torque)])) / highest

    low, high = _free(17 if lags else 13)
    low[RATES], high[RATES] = -np.array(rates.highest), np.array(rates.highest)  # where a step outlasts the rate loop
    low[13:], high[13:] = rotors.min_thrust, rotors.max_thrust
    hovering = np.full(4, vehicle.mass * vehicle.gravity / 4)
    return Model(
        name="four rotors",
        state_size=len(low),
        control=(np.full(4, rotors.min_thrust), np.full(4, rotors.max_thrust)),
        derivative=derivative,
        hover=np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, *hovering], float)[: len(low)],
        lift=hovering,
        state=(low, high),
        path=commanded_rates,
        path_range=(-np.ones(3), np.ones(3)),
    )


def _airframe(vehicle: Vehicle) -> Airframe:
    assert vehicle.airframe is not None
    return vehicle.airframe


def _lag(time_constant: float) -> float:
    return max(time_constant, LEAST_LAG)


def _free(size: int) -> Range:
    return np.full(size, -np.inf), np.full(size, np.inf)


def _motion(vehicle: Vehicle, x: ca.SX, wrench: Wrench) -> FreeBody:
    """The time derivatives of a body under a wrench, in air that stands still."""
    body = FreeBody(*parts(x, POSITION, VELOCITY, ATTITUDE, RATES))
    rate: FreeBody = make_free_derivative(physics_of(vehicle), vehicle.gravity, None, SMOOTH)(body, wrench)
    return rate
