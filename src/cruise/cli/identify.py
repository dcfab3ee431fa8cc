"""`cruise identify`: from flight logs to a vehicle file."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.table import Column, Table

from cruise.cli.console import make_console
from cruise.cli.outputs import check_output
from cruise.config import Vehicle
from cruise.errors import CruiseError
from cruise.toml_file import shown
from cruise.vehicles import VEHICLES, check_vehicle, load_vehicle
from cruise.vehicles.file import write_text

if TYPE_CHECKING:
    from cruise.identify import Found


@dataclass(frozen=True)
class Identify:
    """Fit a vehicle to flight logs: thrust, time constants, delay, drag, torque ratio, each with its 95 % interval.

    Mass, inertia and arms are those of the vehicle to start from, as is what the flights do not tell.
    """

    logs: Annotated[tyro.conf.Positional[tuple[str, ...]], tyro.conf.arg(metavar="LOG...")]
    """Flight logs: .csv, .ulg of PX4, .bbl, .bfl or .txt of Betaflight's Blackbox."""
    start: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")]
    """The vehicle to start from: built-in, or path of a TOML file (`cruise vehicles new` writes one)."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """The vehicle file to write; may be the one to start from. Its name is the vehicle's."""

    def run(self) -> int:
        """Read, fit, print, write. Exit code 0, or 1 where flights do not tell a number."""
        check_output("--out", self.out, ".toml")
        if self.out.stem in VEHICLES:
            raise CruiseError(f"{shown(self.out)}: {self.out.stem!r} is a built-in vehicle: choose another name")
        if not self.logs:
            raise CruiseError("identify needs at least one LOG")
        from cruise.identify import identify, load_log  # noqa: PLC0415  (imports SciPy)
        from cruise.identify.vehicle import identified_text, identified_vehicle  # noqa: PLC0415

        start = load_vehicle(self.start)
        logs = [load_log(log) for log in self.logs]
        found = identify(logs, start)
        source = f"identified from {', '.join(Path(log).name for log in self.logs)}, from {start.name}"
        check_vehicle(identified_vehicle(start, found, self.out.stem, source))
        write_text(self.out, identified_text(start, found, self.out.stem, source))
        print(f"flights   {found.seconds:.1f} s; rotors at their limits in {100 * found.left_out:.0f} % of it")
        make_console().print(found_table(start, found))
        print("\n".join([*_notes(found), *found.missing, f"vehicle   {shown(self.out)}"]))
        return 1 if found.missing else 0


def found_table(start: Vehicle, found: "Found") -> Table:
    """One row a number."""
    from cruise.identify.vehicle import UNITS, in_units  # noqa: PLC0415

    table = Table("number", Column("found", justify="right"), Column("95 % interval", justify="right"), "unit")
    for name, one in in_units(start, found).items():
        if one.told or name not in ("curvature", "damping", "yaw_damping", "drift"):
            cells = (f"{one.value:.4g}", f"{one.low:.4g} to {one.high:.4g}") if one.told else ("-", "-")
            table.add_row(name.replace("_", " "), *cells, UNITS[name])
    return table


def _notes(found: "Found") -> list[str]:
    """What a vehicle file cannot say."""
    notes = []
    if found.by_speed:
        notes.append("rotors    their speeds lag, and drag grows with them, as fits better; drag is that of hovering")
    if found.numbers["curvature"].told:
        thrust, bend = found.numbers["thrust"].value, found.numbers["curvature"].value
        at = ", ".join(f"{u:g}: {thrust * u + bend * u * (1 - u):.1f}" for u in (0.25, 0.5, 0.75, 1.0))
        notes.append(f"throttle  asks for a thrust per mass of ({at} m/s^2): make it straight in the flight controller")
    return notes
