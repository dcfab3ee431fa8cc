"""The simulators there are, by name."""

import importlib.util
import os
import sys

from cruise.config import Vehicle
from cruise.dynamics import Dynamics
from cruise.errors import CruiseError
from cruise.extras import how_to_install

# By name: what is not as in our own simulator, for the same vehicle.
SIMULATORS = {
    "mujoco": "limits rotor by rotor; drag alike along all axes, slows turning too; 500 Hz",
    "rotorpy": "limits rotor by rotor; rotor speeds lag, not thrusts; drag grows with rotor speed; simpler rate loop",
    "crazyflow": "limits rotor by rotor; rotor speeds lag, not thrusts; Euler steps at 500 Hz",
}


def make_simulated(name: str, vehicle: Vehicle) -> Dynamics:
    """The vehicle in one of `SIMULATORS`.

    Raises:
        CruiseError: there is no such simulator, it is not installed, or the vehicle is not flown by thrust and rates.
    """
    if name not in SIMULATORS:
        raise CruiseError(f"unknown simulator {name!r}: there are {', '.join(SIMULATORS)}")
    if not is_installed(name):
        raise CruiseError(f"the simulator {name} is not installed: {how_to_install(name)}")
    from cruise.interop.external import called_back, make_external  # noqa: PLC0415

    if name == "mujoco":
        from cruise.interop.mujoco_sim import MujocoHost  # noqa: PLC0415  (each imports a library that is an extra)

        return make_external(vehicle, called_back(MujocoHost(vehicle)))
    if name == "rotorpy":
        from cruise.interop.rotorpy_sim import RotorpyHost  # noqa: PLC0415

        return make_external(vehicle, called_back(RotorpyHost(vehicle)))
    if "scipy" in sys.modules and os.environ.get("SCIPY_ARRAY_API") != "1":
        raise CruiseError("Crazyflow wants SCIPY_ARRAY_API=1 in the environment before SciPy is imported")
    from cruise.interop.crazyflow_sim import make_advance  # noqa: PLC0415

    return make_external(vehicle, make_advance(vehicle))


def is_installed(name: str) -> bool:
    """Whether the library of a simulator is there."""
    return importlib.util.find_spec(name) is not None
