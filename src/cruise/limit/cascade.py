"""The paper's vehicle for the optimiser: controller and Euler step of `cruise.dynamics.cascade` on symbols."""

import casadi as ca

from cruise.config import Vehicle
from cruise.dynamics.cascade import commanded_acceleration, velocity_error, wrench_from_acceleration
from cruise.dynamics.rigid_body import make_derivative
from cruise.dynamics.types import RigidBody
from cruise.limit.symbols import flat, parts, smooth

STATE_SIZE = 15  # position, velocity, roll pitch and yaw, body rates, velocity error of the step before
POSITION, VELOCITY, EULER, RATES, MEMORY = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), slice(12, 15)
STEEPEST = 1.5  # roll or pitch; Euler angles are singular at a right angle [rad]


def make_step(vehicle: Vehicle, rounding: float) -> ca.Function:
    """Build x, action, h -> x after a step of h seconds, in which the action is held.

    Args:
        vehicle: one that is flown by its own controller in single steps of the explicit Euler method.
        rounding: of the corner where the thrust stops at zero, which an optimiser cannot see round [m/s^2].
    """
    x, u, h = ca.SX.sym("x", STATE_SIZE), ca.SX.sym("u", 3), ca.SX.sym("h")
    algebra = smooth(corner=rounding * vehicle.mass)
    *body_parts, memory = parts(x, POSITION, VELOCITY, EULER, RATES, MEMORY)
    body = RigidBody(*body_parts)
    (action,) = parts(u, slice(0, 3))
    error = velocity_error(action, vehicle.agility, vehicle.control_dt, algebra)
    command = commanded_acceleration(vehicle, error, memory, body.velocity_w)
    rate = make_derivative(vehicle, algebra)(body, wrench_from_acceleration(vehicle, command, body, algebra))
    return ca.Function("step", [x, u, h], [ca.vertcat(x[: MEMORY.start] + h * flat(rate), flat(error))])


def error_of_one(vehicle: Vehicle) -> float:
    """Velocity error that an action of 1 means to the controller, which remembers it until the next step [m/s]."""
    return vehicle.agility * vehicle.control_dt
