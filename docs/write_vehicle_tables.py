"""Writes the tables of `docs/vehicles.md` that follow from declarations: `python docs/write_vehicle_tables.py`."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from cruise.actions import Action
from cruise.config import AttitudeLimits, Vehicle
from cruise.vehicles import VEHICLES, schema

PAGE = Path(__file__).parent / "vehicles.md"


def flown() -> list[tuple[str, Vehicle]]:
    """One vehicle for each kind of action, and who flies so."""
    racer = VEHICLES["racer"]
    assert racer.airframe is not None
    heading = replace(racer.airframe, attitude=AttitudeLimits(yaw="angle"))
    return [
        ("`ctbr`", racer),
        ("`attitude`", replace(racer, control="attitude")),
        ('`attitude`, `yaw = "angle"`', replace(racer, control="attitude", airframe=heading)),
        ("`acceleration`", VEHICLES["paper"]),
        ("`velocity`", replace(racer, control="velocity")),
        ("`position`", replace(racer, control="position")),
    ]


def rows(name: str, action: Action) -> list[str]:
    """One row for each number of an action."""
    found = []
    for k, (number, neutral) in enumerate(zip(action.numbers, action.neutral, strict=True)):
        cells = (number.name, f"{number.low:.4g}", f"{number.high:.4g}", number.unit, f"{neutral:.3g}", number.meaning)
        found.append(f"| {name if k == 0 else ''} | {' | '.join(cells)} |")
    return found


def action_table() -> str:
    """What -1 and 1 mean in each number of each kind of action."""
    head = ["| `control` | number | at -1 | at 1 | unit | hovers | |", "|---|---|---|---|---|---|---|"]
    return "\n".join(head + [row for name, vehicle in flown() for row in rows(name, vehicle.action)])


def key_table() -> str:
    """Every key of a vehicle file."""
    head = ["| table | key | |", "|---|---|---|"]
    keys = [f"| {f'`[{key.table}]`' if key.table else ''} | `{key.name}` | {key.meaning} |" for key in schema.KEYS]
    return "\n".join(head + keys)


TABLES: dict[str, Callable[[], str]] = {"actions": action_table, "keys": key_table}


def written(page: str) -> str:
    """The page with its tables as the declarations have them."""
    for name, table in TABLES.items():
        begin, end = f"<!-- {name}: docs/write_vehicle_tables.py -->\n\n", f"\n\n<!-- end of {name} -->"
        page = re.sub(f"(?<={re.escape(begin)}).*?(?={re.escape(end)})", lambda _, t=table: t(), page, flags=re.DOTALL)
    return page


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text()))
