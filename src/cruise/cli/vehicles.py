"""`cruise vehicles`: what can be flown."""

from dataclasses import dataclass

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from cruise.config import Vehicle
from cruise.vehicles import VEHICLES


@dataclass(frozen=True)
class Vehicles:
    """List the vehicles."""

    def run(self) -> int:
        """Print a table of the vehicles and where their numbers come from."""
        Console().print(vehicle_table())
        return 0


def vehicle_table() -> Table:
    """One row per vehicle."""
    titles = ("mass", "thrust / weight", "rates", "control")
    table = Table("vehicle", *(Column(title, justify="right") for title in titles), "source")
    for vehicle in VEHICLES.values():
        numbers = (f"{vehicle.mass:.4g} kg", thrust_to_weight(vehicle), rates(vehicle))
        control = f"{vehicle.control}, {1 / vehicle.control_dt:.0f} Hz"
        table.add_row(escape(vehicle.name), *numbers, control, escape(vehicle.source))
    return table


def thrust_to_weight(vehicle: Vehicle) -> str:
    """Thrust of all rotors per weight; a dash where nothing limits it."""
    if vehicle.airframe is None or not vehicle.airframe.rotors.saturate:
        return "-"
    return f"{4 * vehicle.airframe.rotors.max_thrust / (vehicle.mass * vehicle.gravity):.2f}"


def rates(vehicle: Vehicle) -> str:
    """Highest body rates."""
    if vehicle.airframe is None:
        return "-"
    return " / ".join(f"{rate:g}" for rate in vehicle.airframe.rates.highest) + " rad/s"
