"""The paper's vehicle for the optimiser: controller and Euler step of `cruise.dynamics.cascade`, written again."""

import casadi as ca

from cruise.config import Vehicle

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
    gains, g = vehicle.controller, vehicle.gravity
    velocity, euler, omega = x[VELOCITY], x[EULER], x[RATES]
    error = error_of_one(vehicle) * u
    desired = gains.velocity_p * error + gains.velocity_d * (error - x[MEMORY])
    command = gains.position_p * desired - gains.position_d * velocity
    tilt = ca.vertcat(-command[1] / g, command[0] / g, 0)
    torque = gains.attitude_p * (tilt - euler) - gains.attitude_d * omega
    thrust = _positive(g + command[2], rounding)
    inertia = ca.DM(list(vehicle.inertia))
    change = ca.vertcat(
        velocity,
        thrust * _thrust_axis(euler) - ca.vertcat(0, 0, g),
        _euler_rates(euler, omega),
        (torque - ca.cross(omega, inertia * omega)) / inertia,
    )
    return ca.Function("step", [x, u, h], [ca.vertcat(x[: MEMORY.start] + h * change, error)])


def error_of_one(vehicle: Vehicle) -> float:
    """Velocity error that an action of 1 means to the controller, which remembers it until the next step [m/s]."""
    return vehicle.agility * vehicle.control_dt


def _positive(value: ca.SX, rounding: float) -> ca.SX:
    return (value + ca.sqrt(value**2 + rounding**2)) / 2


def _thrust_axis(euler: ca.SX) -> ca.SX:
    roll, pitch, yaw = ca.vertsplit(euler)
    ahead, aside = ca.sin(pitch) * ca.cos(roll), ca.sin(roll)
    return ca.vertcat(
        ca.cos(yaw) * ahead + ca.sin(yaw) * aside,
        ca.sin(yaw) * ahead - ca.cos(yaw) * aside,
        ca.cos(pitch) * ca.cos(roll),
    )


def _euler_rates(euler: ca.SX, omega: ca.SX) -> ca.SX:
    roll, pitch, _ = ca.vertsplit(euler)
    p, q, r = ca.vertsplit(omega)
    turn = (q * ca.sin(roll) + r * ca.cos(roll)) / ca.cos(pitch)
    return ca.vertcat(p + turn * ca.sin(pitch), q * ca.cos(roll) - r * ca.sin(roll), turn)
