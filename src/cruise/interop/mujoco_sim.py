"""MuJoCo: its rigid body, its motors with a first-order lag, its model of the air."""

import math
from typing import Any

import mujoco
import numpy as np

from cruise.config import Vehicle
from cruise.dynamics import FreeBody
from cruise.dynamics.rotors import YAW, places
from cruise.interop.flight_controller import airframe_of, rotor_commands, rotors_of

RATE = 500  # of the flight controller and of the physics [Hz]

MODEL = """
<mujoco>
  <option timestep="{dt}" integrator="implicitfast" gravity="0 0 -{g}" viscosity="{viscosity}"/>
  <worldbody>
    <geom type="plane" size="0 0 0.1"/>
    <body pos="0 0 1">
      <freejoint/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{jx} {jy} {jz}"/>
      <geom type="sphere" size="0.03" mass="0"/>
      {sites}
    </body>
  </worldbody>
  <actuator>
    {motors}
  </actuator>
</mujoco>
"""


class MujocoHost:
    """One model, and one state of it for every drone."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Write the vehicle as a MuJoCo model.

        Raises:
            CruiseError: it has no rotors.
        """
        self.vehicle = vehicle
        self.model = mujoco.MjModel.from_xml_string(model_of(vehicle))
        self.substeps = round(vehicle.control_dt * RATE)
        self._data: list[Any] = []

    def advance(self, body: FreeBody, thrusts: Any, thrust: Any, rates_b: Any) -> tuple[FreeBody, Any]:
        """One control step of every drone, from the states that are given."""
        drones = self._placed(body, thrusts)
        for _ in range(self.substeps):
            measured = np.array([data.qvel[3:] for data in drones]).T
            commands = np.array(rotor_commands(self.vehicle, thrust, rates_b, measured)).T
            for data, command in zip(drones, commands, strict=True):
                data.ctrl[:] = command
                mujoco.mj_step(self.model, data)
        places, motions = (np.array([getattr(data, name) for data in drones]).T for name in ("qpos", "qvel"))
        moved = FreeBody(places[:3], motions[:3], places[3:], motions[3:])
        return moved, np.array([data.act for data in drones]).T

    def _placed(self, body: FreeBody, thrusts: Any) -> list[Any]:
        """Every drone's own state, set. Quaternions and frames are as ours: (w, x, y, z), rates in the body's axes."""
        count = thrusts.shape[1]
        self._data += [mujoco.MjData(self.model) for _ in range(count - len(self._data))]
        for k, data in enumerate(self._data[:count]):
            data.qpos[:] = np.concatenate([body.position_w[:, k], body.attitude[:, k]])
            data.qvel[:] = np.concatenate([body.velocity_w[:, k], body.angular_velocity_b[:, k]])
            data.act[:] = thrusts[:, k]
        return self._data[:count]


def model_of(vehicle: Vehicle) -> str:
    """The vehicle in MuJoCo's language."""
    rotors, drag = rotors_of(vehicle), airframe_of(vehicle).drag
    sites, motors = [], []
    for number, ((x, y, _), spin) in enumerate(zip(places(rotors), YAW, strict=True)):
        sites.append(f'<site name="rotor{number}" pos="{x} {y} 0"/>')
        lag = f'dyntype="filterexact" dynprm="{rotors.time_constant}"' if rotors.time_constant else ""
        limits = f'ctrlrange="{rotors.min_thrust} {rotors.max_thrust}"'
        gear = f"0 0 1 0 0 {spin * rotors.torque_ratio}"
        motors.append(f'<general site="rotor{number}" gear="{gear}" gainprm="1" {limits} {lag}/>')
    jx, jy, jz = vehicle.inertia
    return MODEL.format(
        dt=1 / RATE,
        g=vehicle.gravity,
        viscosity=drag.horizontal / (6 * math.pi * _radius(vehicle)),
        mass=vehicle.mass,
        jx=jx,
        jy=jy,
        jz=jz,
        sites="\n      ".join(sites),
        motors="\n    ".join(motors),
    )


def _radius(vehicle: Vehicle) -> float:
    """Of the sphere by which MuJoCo computes viscous drag, 6 pi eta r v: the mean half side of a box so inert [m]."""
    jx, jy, jz = vehicle.inertia
    sides = (math.sqrt(6 * (a + b - c) / vehicle.mass) for a, b, c in ((jy, jz, jx), (jx, jz, jy), (jx, jy, jz)))
    return sum(sides) / 6
