"""Vehicles as differential equations in CasADi, for the optimiser: the physics of `cruise.dynamics`, written again.

Three are told apart: a point mass whose thrust points anywhere at once; a body whose rates are commanded; and a body
with four rotors, whose limits and lag bind one by one.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from cruise.config import Airframe, Drag, Vehicle
from cruise.dynamics.rotors import PITCH, ROLL, YAW, levers

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 10)
LEAST_LAG = 1e-3  # of what does not lag: a state needs an equation [s]
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
        flow = (u[0] - x[13]) / thrust_lag
        return ca.vertcat(_motion(vehicle, x, x[13]), _turning(x, x[10:13]), (u[1:4] - x[10:13]) / rates_lag, flow)

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
    """State p, v, q, rates, four thrusts [N]; control: the thrusts that the rotors head for.

    A rate loop may ask for no other torque than J (omega_c - omega) / t + omega x J omega with omega_c within its
    limits: that is the inequality.
    """
    airframe = _airframe(vehicle)
    rotors, rates = airframe.rotors, airframe.rates
    inertia = ca.DM(list(vehicle.inertia))
    highest = np.array(rates.highest)
    rows = zip((ROLL, PITCH, YAW), levers(rotors), strict=True)
    mixer = ca.DM([[1.0] * 4, *(lever * np.array(signs) for signs, lever in rows)])

    def torque_free(omega: ca.SX, torque: ca.SX) -> ca.SX:
        return (torque - ca.cross(omega, inertia * omega)) / inertia

    def derivative(x: ca.SX, u: ca.SX) -> ca.SX:
        omega, thrusts = x[10:13], x[13:17]
        wrench = mixer @ thrusts
        flow = (u - thrusts) / _lag(airframe.rotors.time_constant)
        spin = torque_free(omega, wrench[1:4])
        return ca.vertcat(_motion(vehicle, x, wrench[0] / vehicle.mass), _turning(x, omega), spin, flow)

    def commanded_rates(x: ca.SX, u: ca.SX) -> ca.SX:
        omega = x[10:13]
        return (omega + rates.time_constant * torque_free(omega, (mixer @ u)[1:4])) / highest

    low, high = _free(17)
    low[13:], high[13:] = rotors.min_thrust, rotors.max_thrust
    hovering = np.full(4, vehicle.mass * vehicle.gravity / 4)
    return Model(
        name="four rotors",
        state_size=17,
        control=(np.full(4, rotors.min_thrust), np.full(4, rotors.max_thrust)),
        derivative=derivative,
        hover=np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, *hovering], float),
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


def thrust_axis(attitude: ca.SX) -> ca.SX:
    """The body's z axis in the world, of a unit quaternion (w, x, y, z)."""
    w, x, y, z = ca.vertsplit(attitude)
    return ca.vertcat(2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))


def _motion(vehicle: Vehicle, x: ca.SX, thrust: ca.SX) -> ca.SX:
    """Give p' and v' under a thrust per mass [m/s^2] along the body's z axis, with drag."""
    axis, velocity = thrust_axis(x[ATTITUDE]), x[VELOCITY]
    acceleration = thrust * axis - ca.vertcat(0, 0, vehicle.gravity)
    return ca.vertcat(velocity, acceleration + _drag(_airframe(vehicle).drag, velocity, axis) / vehicle.mass)


def _drag(drag: Drag, velocity: ca.SX, axis: ca.SX) -> ca.SX:
    """[N], as `cruise.dynamics.drag` has it."""
    across = drag.horizontal
    force = -across * velocity - (drag.vertical - across) * ca.dot(velocity, axis) * axis
    if drag.quadratic:
        force -= drag.quadratic * ca.sqrt(ca.dot(velocity, velocity) + 1e-6) * velocity
    return force


def _turning(x: ca.SX, omega: ca.SX) -> ca.SX:
    """Give q' = q (0, omega) / 2."""
    w, vector = x[6], x[7:10]
    return 0.5 * ca.vertcat(-ca.dot(vector, omega), w * omega + ca.cross(vector, omega))
