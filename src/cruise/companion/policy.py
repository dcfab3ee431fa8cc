"""An exported policy with the gates where they really stand: state in, thrust and body rates out."""

from pathlib import Path
from typing import Any

import numpy as np

from cruise.companion.odometry import Odometry
from cruise.config import Pole, Track
from cruise.dynamics.attitude import Setpoint
from cruise.errors import CruiseError
from cruise.geometry import beyond_opening, heading_of, plane_fraction, tilt_of, to_gate
from cruise.racing.motion import must_stand_still
from cruise.storage.onnx_file import open_model, read_contract
from cruise.storage.onnx_pilot import FedBack, check_tilt
from cruise.vehicles import find_vehicle


class OnnxPolicy:
    """A policy alone on a track, and which gate comes next."""

    def __init__(self, path: Path, track: Track) -> None:
        """Raises CruiseError where it is no policy told thrust and body rates, or needs others around it."""
        self._session, contract = open_model(path), read_contract(path)
        meta, self.control_dt = contract.policy, contract.control_dt
        names = {port.name for port in contract.outputs}
        if contract.interface != "state" or not {"thrust", "body_rates_b"} <= names:
            raise CruiseError(f"model {path}: a drone is flown by thrust and body rates, and this gives neither")
        check_tilt(contract, any(gate.roll or gate.pitch for gate in track.gates))
        self.name, self.vehicle = meta.name, find_vehicle(meta.vehicle)
        self.track, self.next_gate = track, track.start_gate
        self._takes = {port.name for port in contract.inputs}
        self._fed_back, self._begins = FedBack(contract), np.array([True])
        self._before: np.ndarray | None = None
        self._fixed = _fixed(track, max(1, meta.drones - 1))

    def act(self, state: Odometry) -> tuple[np.ndarray, Setpoint]:
        """The action in [-1, 1] [4], and what it asks of the flight controller. Gates that were passed count."""
        self._pass_gates(state.position_w)
        inputs = self._fixed | {
            "position_w": state.position_w[None],
            "velocity_w": state.velocity_w[None],
            "attitude": state.attitude[None],
            "angular_velocity_b": state.angular_velocity_b[None],
        }
        given: dict[str, Any] = {
            name: np.asarray(value, bool if name == "others_airborne" else np.float32)
            for name, value in inputs.items()
            if name in self._takes
        }
        given |= self._fed_back.inputs(self._begins) | {"next_gate": np.array([self.next_gate], np.int64)}
        names = ["thrust", "body_rates_b", *self._fed_back.outputs]
        said = dict(zip(names, self._session.run(names, given), strict=True))
        self._fed_back.keep(said)
        self._begins = np.array([False])
        p, q, r = (float(one) for one in said["body_rates_b"][0])
        return said["action"][0], Setpoint(float(said["thrust"][0]), (p, q, r))

    def _pass_gates(self, position_w: np.ndarray) -> None:
        """Count the target where the way since the last state went through its opening, forward."""
        if self._before is not None:
            gate = self.track.gates[self.next_gate]
            heading, tilt, centre = heading_of(gate.yaw), tilt_of(gate.roll, gate.pitch), np.array(gate.position_w)
            start, end = (np.array(to_gate(heading, tuple(at - centre), tilt)) for at in (self._before, position_w))
            if start[0] < 0 <= end[0]:
                _, left, up = start + float(plane_fraction(start[0], end[0])) * (end - start)
                if beyond_opening(left, up, gate.width / 2, gate.height / 2, gate.shape == "round") <= 0:
                    self.next_gate = (self.next_gate + 1) % len(self.track.gates)
        self._before = position_w


def _fixed(track: Track, others: int) -> dict[str, Any]:
    """What stays the same: gates, and nobody else."""
    must_stand_still(track, "a drone of your own is flown through")
    nobody = np.zeros((1, others, 3))
    return {
        "gate_position_w": [gate.position_w for gate in track.gates],
        "gate_yaw": [gate.yaw for gate in track.gates],
        "gate_size": [gate.size for gate in track.gates],
        "gate_tilt": [(gate.roll, gate.pitch) for gate in track.gates],
        "pole_position_w": [pole.base_w for pole in track.obstacles if isinstance(pole, Pole)],
        "others_position_w": nobody,
        "others_velocity_w": nobody,
        "others_airborne": np.zeros((1, others), bool),
    }
