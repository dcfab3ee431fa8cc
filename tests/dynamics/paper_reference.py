"""The paper's vehicle again, in plain float64 NumPy: written from its equations, sharing no line with the package.

One drone, one step at a time, matrices spelled out. Numbers are those of the paper's repository.
"""

from dataclasses import dataclass, field

import numpy as np

MASS, GRAVITY, DT = 1.0, 9.81, 0.1
INERTIA = np.diag([0.005, 0.005, 0.009])
K_V, K_VD = 0.42 * np.eye(3), 2.0 * np.eye(3)
K_P_POS, K_D_POS = 5.0 * np.eye(3), 0.05 * np.eye(3)
K_P_ATT, K_D_ATT = 0.1 * np.eye(3), 0.05 * np.eye(3)


def rotation_x(angle: float) -> np.ndarray:
    return np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])


def rotation_y(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


def rotation_z(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def body_to_world(euler: np.ndarray) -> np.ndarray:
    """R_WB of ZYX Euler angles."""
    roll, pitch, yaw = euler
    return rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)


def rates_matrix(euler: np.ndarray) -> np.ndarray:
    """W_Theta: from body rates to Euler rates."""
    roll, pitch, _ = euler
    return np.array(
        [
            [1, np.sin(roll) * np.tan(pitch), np.cos(roll) * np.tan(pitch)],
            [0, np.cos(roll), -np.sin(roll)],
            [0, np.sin(roll) / np.cos(pitch), np.cos(roll) / np.cos(pitch)],
        ]
    )


@dataclass
class Drone:
    """State of the vehicle and the velocity error its controller remembers."""

    position: np.ndarray
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    euler: np.ndarray = field(default_factory=lambda: np.zeros(3))
    rates: np.ndarray = field(default_factory=lambda: np.zeros(3))
    last_error: np.ndarray = field(default_factory=lambda: np.zeros(3))


def control(drone: Drone, action: np.ndarray, agility: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Thrust, torque and the velocity error of this step."""
    desired_velocity = drone.velocity + agility * np.clip(action, -1, 1) * DT
    error = desired_velocity - drone.velocity
    desired_acceleration = K_V @ error + K_VD @ (error - drone.last_error)
    command = K_P_POS @ desired_acceleration - K_D_POS @ drone.velocity
    thrust = MASS * GRAVITY + MASS * command[2]
    thrust = max(thrust, 0.0)  # not printed: a rotor cannot pull down
    desired_euler = np.array([-command[1] / GRAVITY, command[0] / GRAVITY, 0.0])
    torque = K_P_ATT @ (desired_euler - drone.euler) - K_D_ATT @ drone.rates
    return thrust, torque, error


def step(drone: Drone, action: np.ndarray, agility: float) -> Drone:
    """Explicit Euler over 0.1 s: every rate from the state before the step."""
    thrust, torque, error = control(drone, action, agility)
    acceleration = np.array([0, 0, -GRAVITY]) + body_to_world(drone.euler) @ np.array([0, 0, thrust]) / MASS
    angular_momentum = INERTIA @ drone.rates
    angular_acceleration = np.linalg.solve(INERTIA, torque - np.cross(drone.rates, angular_momentum))
    position = drone.position + DT * drone.velocity
    position[2] = max(position[2], 0.0)
    return Drone(
        position=position,
        velocity=drone.velocity + DT * acceleration,
        euler=drone.euler + DT * rates_matrix(drone.euler) @ drone.rates,
        rates=drone.rates + DT * angular_acceleration,
        last_error=error,
    )


def fly(drone: Drone, actions: np.ndarray, agility: float) -> dict[str, np.ndarray]:
    """Every state of a flight under `actions` [T, 3]: arrays [T, 3] named as in the package."""
    flown = []
    for action in actions:
        drone = step(drone, action, agility)
        flown.append(drone)
    names = {"position_w": "position", "velocity_w": "velocity", "euler": "euler", "angular_velocity_b": "rates"}
    return {ours: np.array([getattr(d, theirs) for d in flown]) for ours, theirs in names.items()}
