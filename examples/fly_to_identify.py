"""Flies a vehicle in another simulator, as its team would to identify it, and writes what it logged as CSV.

python examples/fly_to_identify.py mujoco true.toml flight.csv     or rotorpy; 30 s take half a minute
"""

import sys
from dataclasses import replace

import numpy as np

from cruise.config import Vehicle
from cruise.dynamics import FreeBody
from cruise.identify.csv_log import OPTIONAL, REQUIRED
from cruise.identify.grid import rotation_matrix
from cruise.interop.flight_controller import rotor_commands
from cruise.vehicles import load_vehicle

ROW = 0.004  # [s] from row to row
COLUMNS = [column for columns in (REQUIRED | OPTIONAL).values() for column in columns if "acceleration" not in column]


def host_of(simulator, vehicle):
    """The vehicle in a simulator that is not ours, which is asked anew every row."""
    fine = replace(vehicle, control_dt=ROW, substeps=1)
    if simulator == "mujoco":
        from cruise.interop.mujoco_sim import MujocoHost  # noqa: PLC0415  (each needs a library of its own)

        return MujocoHost(fine)
    from cruise.interop.rotorpy_sim import RotorpyHost  # noqa: PLC0415

    return RotorpyHost(fine)


def fly(vehicle: Vehicle, simulator: str, seconds: float, seed: int = 0) -> np.ndarray:
    """Rows of the columns: eights at several speeds and heights, and steps of thrust and rates on top of them."""
    host, pilot = host_of(simulator, vehicle), Pilot(vehicle, np.random.default_rng(seed))
    body = FreeBody(
        np.array([[0.0], [0.0], [50.0]]), np.zeros((3, 1)), np.array([[1.0], [0], [0], [0]]), np.zeros((3, 1))
    )
    thrusts = np.full((4, 1), vehicle.mass * vehicle.gravity / 4)
    every, late = round(vehicle.control_dt / ROW), round(vehicle.airframe.delay / ROW)
    asked = [(vehicle.gravity / vehicle.agility, np.zeros(3))] * (late + 1)
    rows = []
    for k in range(int(seconds / ROW)):
        asked.append(pilot.command(k * ROW, body) if k % every == 0 else asked[-1])
        throttle, rates = asked[-1 - late]
        thrust, wanted = np.array([throttle * vehicle.agility]), rates[:, None]
        motors = motors_of(host, vehicle, body, throttle, rates)
        measured = (body.angular_velocity_b, body.attitude, body.velocity_w)
        shares = motors / vehicle.airframe.rotors.max_thrust
        rows.append([k * ROW, asked[-1][0], *asked[-1][1], *np.concatenate(measured)[:, 0], *shares])
        body, thrusts = host.advance(body, thrusts, thrust, wanted)
    return np.array(rows)


def motors_of(host, vehicle, body, throttle, rates):
    """What the simulator's own flight controller asks of the four motors [N]."""
    thrust = throttle * vehicle.agility
    if not hasattr(host, "multirotor"):
        asked = np.array([thrust]), rates[:, None]
        return np.array(rotor_commands(vehicle, *asked, body.angular_velocity_b))[:, 0]
    control = {"cmd_thrust": vehicle.mass * thrust, "cmd_w": rates}
    speeds = host.multirotor.get_cmd_motor_speeds({"w": body.angular_velocity_b[:, 0]}, control)
    return host.thrust_factor * np.clip(speeds, 0.0, host.multirotor.rotor_speed_max) ** 2


class Pilot:
    """Holds a path, and steps thrust and rates up and down on top of that: what tells lags and delay."""

    def __init__(self, vehicle, chance):
        self.vehicle, self.chance = vehicle, chance
        self.step, self.until = np.zeros(4), 0.0

    def command(self, time, body):
        """Throttle and body rates."""
        if time >= self.until:
            self.step = self.chance.uniform(-1, 1, 4) * [0.2, 1.6, 1.6, 0.8]
            self.until = time + self.chance.uniform(0.08, 0.3)
        w, turn = 0.6, rotation_matrix(body.attitude)[:, :, 0]
        place = np.array([8 * np.sin(w * time), 6 * np.sin(2 * w * time), 50 + 3 * np.sin(1.3 * time)])
        speed = np.array([8 * w * np.cos(w * time), 12 * w * np.cos(2 * w * time), 3.9 * np.cos(1.3 * time)])
        ahead = np.array(
            [-8 * w * w * np.sin(w * time), -24 * w * w * np.sin(2 * w * time), -5.07 * np.sin(1.3 * time)]
        )
        force = ahead + 2.0 * (place - body.position_w[:, 0]) + 2.5 * (speed - body.velocity_w[:, 0])
        force[2] += self.vehicle.gravity
        lean = turn.T @ (force / np.linalg.norm(force))
        throttle = np.clip(force @ turn[:, 2] * (1 + self.step[0]) / self.vehicle.agility, 0.12, 0.7)
        highest = np.array(self.vehicle.airframe.rates.highest)
        return throttle, np.clip(np.array([-lean[1], lean[0], 0.0]) * 6 + self.step[1:], -highest, highest)


if __name__ == "__main__":
    simulator, file, out = sys.argv[1:4]
    rows = fly(load_vehicle(file), simulator, float(sys.argv[4]) if len(sys.argv) > 4 else 30.0)
    np.savetxt(out, rows, delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.6g")
