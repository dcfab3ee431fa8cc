"""`cruise vehicles list | show NAME|FILE | check FILE... | new FILE`: what can be flown."""

import math
import os
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Column, Table

from cruise.cli.console import make_console
from cruise.cli.line_up import described
from cruise.cli.outputs import check_output
from cruise.config import Vehicle
from cruise.errors import CruiseError
from cruise.files import write_whole
from cruise.toml_file import positive, shown
from cruise.vehicles import VEHICLES, check_vehicle, load_vehicle
from cruise.vehicles.derived import figures, thrust_to_weight
from cruise.vehicles.document import to_text, value_at
from cruise.vehicles.file import file_faults, write_text
from cruise.vehicles.guess import GUESSES, Measured, guessed_vehicle


@dataclass(frozen=True)
class List:
    """List the built-in vehicles."""

    def run(self) -> int:
        """Print a table of the vehicles and, below it, where their numbers come from."""
        make_console().print(vehicle_table())
        for vehicle in VEHICLES.values():
            print(f"{vehicle.name}\n  {vehicle.source}")
        return 0


@dataclass(frozen=True)
class Show:
    """Show a vehicle's numbers, what follows from them, and what its actions mean."""

    vehicle: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME|FILE")]
    """Name of a built-in vehicle, or path of a TOML file."""
    png: Annotated[Path | None, described("FILE.png")] = None
    """Draw it from above, to scale, and how its rates answer."""

    def run(self) -> int:
        """Print the vehicle's file, then figures and the action; draw it where asked to."""
        check_output("--png", self.png, ".png")
        vehicle = load_vehicle(self.vehicle)
        if self.png is not None:
            from cruise.report.vehicle_figure import draw_vehicle  # noqa: PLC0415  (imports Matplotlib)

            write_whole(self.png, draw_vehicle(vehicle))
        print(to_text(vehicle))
        make_console().print(figure_table(vehicle))
        make_console().print(action_table(vehicle))
        return 0


@dataclass(frozen=True)
class Check:
    """Check vehicle files: exit code 0 and a summary of each, or 1 and every fault on a line of its own.

    Where a file cannot be read the exit code is 2, as it is wherever input is bad.
    """

    vehicles: Annotated[tyro.conf.Positional[tuple[str, ...]], tyro.conf.arg(metavar="FILE...")]
    """Paths of TOML files, or names of built-in vehicles."""

    def run(self) -> int:
        """Print the summaries, and the faults to standard error."""
        if not self.vehicles:
            raise CruiseError("vehicles check needs at least one FILE")
        return max([_check(choice) for choice in self.vehicles])


@dataclass(frozen=True)
class New:
    """Write a vehicle file to start from: what you give as it is, the rest guessed and marked so."""

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """The file to write, which must not be there yet; its name is the vehicle's."""
    mass: float = Measured.mass
    """Of all that flies, battery included [kg]."""
    arm: float = Measured.arm
    """From the centre to a motor [m]."""
    propeller: float = Measured.propeller
    """Diameter of a propeller [m]; an inch is 0.0254 m."""
    thrust: float = Measured.thrust
    """Of one motor at full throttle [N]."""

    def run(self) -> int:
        """Write the file and say what it describes."""
        known = Measured(self.mass, self.arm, self.propeller, self.thrust)
        for field in fields(known):
            if fault := positive(getattr(known, field.name)):
                raise CruiseError(f"--{field.name} {fault}")
        if self.file.suffix != ".toml":
            raise CruiseError(f"{shown(self.file)}: a vehicle file ends in .toml")
        if os.path.lexists(self.file):
            raise CruiseError(f"{shown(self.file)} is there already: choose another name, or remove it first")
        vehicle = guessed_vehicle(self.file.stem, known)
        check_vehicle(vehicle)
        if vehicle.name in VEHICLES:
            raise CruiseError(f"{shown(self.file)}: {vehicle.name!r} is a built-in vehicle: choose another name")
        write_text(self.file, to_text(vehicle, GUESSES))
        print(f"vehicle {shown(self.file)}\n{summary(vehicle)}")
        return 0


@dataclass(frozen=True)
class Vehicles:
    """List, show, check and write vehicles."""

    command: (
        Annotated[List, tyro.conf.subcommand("list")]
        | Annotated[Show, tyro.conf.subcommand("show")]
        | Annotated[Check, tyro.conf.subcommand("check")]
        | Annotated[New, tyro.conf.subcommand("new")]
    ) = List()

    def run(self) -> int:
        """Run the sub-command and give its exit code."""
        return self.command.run()


def _check(choice: str) -> int:
    """Exit code of one file: 1 with faults, 2 where there is no file to look at."""
    try:
        faults = [] if choice in VEHICLES else file_faults(choice)
    except CruiseError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    for fault in faults:
        print(f"{shown(choice)}: {fault}", file=sys.stderr)
    if faults:
        return 1
    print(f"{shown(choice)}: no faults; {summary(load_vehicle(choice))}")
    return 0


def summary(vehicle: Vehicle) -> str:
    """A vehicle in one line."""
    said = f"{vehicle.name}: {vehicle.mass:.4g} kg, told {vehicle.action.kind} at {1 / vehicle.control_dt:.0f} Hz"
    strength = thrust_to_weight(vehicle)
    return f"{said}, lifts {strength:.2f} times its weight" if math.isfinite(strength) else said


def vehicle_table() -> Table:
    """One row per built-in vehicle."""
    titles = ("mass [kg]", "thrust/weight", "rates [rad/s]", "action", "Hz")
    table = Table("vehicle", *(Column(title, justify="right") for title in titles))
    for vehicle in VEHICLES.values():
        strength, highest = thrust_to_weight(vehicle), value_at(vehicle, "airframe.rates.highest")
        numbers = (
            f"{vehicle.mass:.4g}",
            f"{strength:.2f}" if math.isfinite(strength) else "-",
            "-" if highest is None else "/".join(f"{rate:.3g}" for rate in highest),
        )
        table.add_row(vehicle.name, *numbers, vehicle.action.kind, f"{1 / vehicle.control_dt:.0f}")
    return table


def figure_table(vehicle: Vehicle) -> Table:
    """What follows from the numbers."""
    table = Table("figure", Column("value", justify="right"), "meaning")
    for figure in figures(vehicle):
        table.add_row(figure.name, f"{figure.value} {figure.unit}".strip(), figure.meaning)
    return table


def action_table(vehicle: Vehicle) -> Table:
    """What -1 and 1 mean in each number of an action."""
    action = vehicle.action
    title = f"action: {action.kind}, in the {action.frame}'s frame"
    numbers = (Column(name, justify="right") for name in ("at -1", "at 1", "hovers"))
    table = Table("number", *numbers, "meaning", title=title)
    for number, neutral in zip(action.numbers, action.neutral, strict=True):
        ends = (f"{end:.4g} {number.unit}" for end in (number.low, number.high))
        table.add_row(number.name, *ends, f"{neutral:.3g}", number.meaning)
    return table
