"""RotorPy: its rate loop, its rotors whose speeds lag and whose drag grows with their speed, its integrator."""

import math
from typing import Any

import numpy as np
from rotorpy.vehicles.multirotor import Multirotor

from cruise.config import Vehicle
from cruise.dynamics import FreeBody
from cruise.dynamics.rotors import YAW, places
from cruise.interop.flight_controller import airframe_of, hover_thrust, rotors_of

RATE = 250  # of the rate loop [Hz]
FASTEST = 2500.0  # of the rotors; thrust and drag are fitted to it, so that any will do [rad/s]


class RotorpyHost:
    """One vehicle, which any state may be handed to."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Hand RotorPy the vehicle's numbers.

        Raises:
            CruiseError: it has no rotors.
        """
        self.mass = vehicle.mass
        self.substeps = round(vehicle.control_dt * RATE)
        self.dt = vehicle.control_dt / self.substeps
        parameters = parameters_of(vehicle)
        self.thrust_factor = parameters["k_eta"]
        self.multirotor = Multirotor(
            parameters, control_abstraction="cmd_ctbr", integrator_kwargs={"method": "RK23", "max_step": self.dt}
        )

    def advance(self, body: FreeBody, thrusts: Any, thrust: Any, rates_b: Any) -> tuple[FreeBody, Any]:
        """One control step of every drone. RotorPy's quaternions are (x, y, z, w)."""
        ends = []
        for k in range(thrusts.shape[1]):
            state = {
                "x": body.position_w[:, k],
                "v": body.velocity_w[:, k],
                "q": np.roll(body.attitude[:, k], -1),
                "w": body.angular_velocity_b[:, k],
                "wind": np.zeros(3),
                "rotor_speeds": np.sqrt(np.maximum(thrusts[:, k], 0.0) / self.thrust_factor),
            }
            control = {"cmd_thrust": self.mass * thrust[k], "cmd_w": rates_b[:, k]}
            for _ in range(self.substeps):
                state = self.multirotor.step(state, control, self.dt)
            ends.append(state)
        x, v, q, w, speeds = (np.array([end[name] for end in ends]).T for name in ("x", "v", "q", "w", "rotor_speeds"))
        return FreeBody(x, v, np.roll(q, 1, axis=0), w), self.thrust_factor * speeds**2


def parameters_of(vehicle: Vehicle) -> dict[str, Any]:
    """The vehicle in RotorPy's words."""
    rotors, airframe = rotors_of(vehicle), airframe_of(vehicle)
    thrust_factor = rotors.max_thrust / FASTEST**2
    hovering = math.sqrt(hover_thrust(vehicle) / thrust_factor)
    return {
        "mass": vehicle.mass,
        **dict(zip(("Ixx", "Iyy", "Izz"), vehicle.inertia, strict=True)),
        **dict.fromkeys(("Ixy", "Ixz", "Iyz"), 0.0),
        "num_rotors": 4,
        "rotor_pos": {f"r{number}": np.array(place) for number, place in enumerate(places(rotors), start=1)},
        "rotor_directions": np.array(YAW),
        "rotor_speed_min": math.sqrt(rotors.min_thrust / thrust_factor),
        "rotor_speed_max": FASTEST,
        "k_eta": thrust_factor,
        "k_m": thrust_factor * rotors.torque_ratio,
        "k_d": airframe.drag.horizontal / (4 * hovering),
        "k_z": airframe.drag.vertical / (4 * hovering),
        "c_Dx": airframe.drag.quadratic,
        "c_Dy": airframe.drag.quadratic,
        "c_Dz": airframe.drag.quadratic,
        "tau_m": max(rotors.time_constant, 1e-3),
        "k_w": 1 / airframe.rates.time_constant,
    }
