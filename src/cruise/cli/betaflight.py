"""`cruise betaflight settings | check FILE`: what a drone's firmware is set to."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from cruise.cli.line_up import described
from cruise.vehicles import load_vehicle

CURVE = """
# Throttle for the companion computer: with c the thrust per mass that the policy asks for, and {top:.4g} m/s^2 that of
# all rotors, its share is c / {top:.4g} where thrust grows linearly with the command. Measure it on a thrust stand:
# where it grows with the square, take the root of that, or `set thrust_linear`.
"""


@dataclass(frozen=True)
class Settings:
    """Print the lines that set a drone's firmware so that it flies as the vehicle does, each with what it is for."""

    vehicle: Annotated[str, described("NAME|FILE")] = "racer"
    """A built-in vehicle, or path of a TOML file. By default racer."""

    def run(self) -> int:
        """Print them, to be pasted into the firmware's command line."""
        from cruise.interop.betaflight.settings import vehicle_text  # noqa: PLC0415  (imports JAX)
        from cruise.interop.flight_controller import airframe_of  # noqa: PLC0415

        vehicle = load_vehicle(self.vehicle)
        print(vehicle_text(vehicle))
        print(CURVE.format(top=4 * airframe_of(vehicle).rotors.max_thrust / vehicle.mass).strip())
        return 0


@dataclass(frozen=True)
class Check:
    """Set the firmware as a drone is set, and say which lines mean nothing to it."""

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """Output of `diff all`."""
    vehicle: Annotated[str, described("NAME|FILE")] = "racer"
    """What it flies: a built-in vehicle, or path of a TOML file. By default racer."""

    def run(self) -> int:
        """Exit code 0 where every line counts, else 1."""
        from cruise.config import Firmware  # noqa: PLC0415
        from cruise.interop.betaflight.configure import configured  # noqa: PLC0415  (imports JAX)
        from cruise.interop.betaflight.settings import lines_for, read_cli  # noqa: PLC0415

        lines = read_cli(self.file)
        found = configured(lines_for(load_vehicle(self.vehicle), Firmware("stock", lines)))
        print(f"{self.file}: {len(lines) - len(found.refused)} of {len(lines)} lines that say how it flies are taken")
        for line in found.refused:
            print(f"  means nothing here: {line}")
        return 1 if found.refused else 0


@dataclass(frozen=True)
class Betaflight:
    """Print what a drone's firmware must be set to, or check what it is set to."""

    command: Annotated[Settings, tyro.conf.subcommand("settings")] | Annotated[Check, tyro.conf.subcommand("check")]

    def run(self) -> int:
        """Run the sub-command and give its exit code."""
        return self.command.run()
