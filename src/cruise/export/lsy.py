"""A policy as a controller of TU Munich's drone racing course, utiasDSL/lsy_drone_racing: one file for its folder."""

import base64
import textwrap
from importlib import resources
from string import Template

from cruise import __version__
from cruise.config import Track, Vehicle
from cruise.errors import CruiseError
from cruise.storage.onnx_file import Port
from cruise.storage.policy_file import Policy
from cruise.vehicles import find_vehicle

CONTROL_DT = 0.02  # their environment asks for a command so often [s]


def check_lsy(policy: Policy) -> None:
    """Raises CruiseError where the course has no use for a policy."""
    meta = policy.meta
    vehicle = find_vehicle(meta.vehicle)
    wrong = _wrong(vehicle, meta.drones)
    if wrong:
        raise CruiseError(
            f"policy {meta.name!r} {wrong}; a controller of the LSY course tells one drone roll, pitch, yaw and thrust "
            "50 times a second: train with --vehicle examples/vehicles/lsy-course.toml --drones 1"
        )


def _wrong(vehicle: Vehicle, drones: int) -> str:
    if drones != 1:
        return f"is for {drones} drones"
    if vehicle.control != "attitude" or vehicle.airframe is None or vehicle.airframe.attitude.yaw != "angle":
        return f"does not tell its vehicle {vehicle.name!r} roll, pitch and yaw"
    return "" if abs(vehicle.control_dt - CONTROL_DT) < 1e-9 else f"is asked every {vehicle.control_dt:g} s"


def lsy_controller(policy: Policy, track: Track, inputs: tuple[Port, ...], model: bytes) -> str:
    """The file: `model` is the whole pilot as an ONNX model, in text, with these inputs."""
    vehicle = find_vehicle(policy.meta.vehicle)
    template = resources.files("cruise.export").joinpath("lsy_files", "controller.py.in").read_text(encoding="utf-8")
    words = {
        "name": repr(policy.meta.name),
        "version": __version__,
        "track": repr(track.name),
        "first": repr({port.name: port.first for port in inputs if port.first}),
        "mass": repr(vehicle.mass),
        "sizes": repr([gate.size for gate in track.gates]),
        "model": "\n".join(textwrap.wrap(base64.b64encode(model).decode(), 116)),
    }
    return Template(template).substitute(words)
