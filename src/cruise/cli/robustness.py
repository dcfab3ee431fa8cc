"""`cruise robustness`: what pilots make of vehicles, air, gates and sensors that are not as they should be."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.table import Column, Table

from cruise.cli.compilation import prepare_flight
from cruise.cli.console import make_console
from cruise.cli.evaluate import counted, number
from cruise.cli.line_up import LineUp, described
from cruise.cli.outputs import check_output
from cruise.config import OUR_SIMULATOR
from cruise.errors import CruiseError

if TYPE_CHECKING:
    from cruise.evaluation.matches import Match
    from cruise.evaluation.robustness import Point


@dataclass(frozen=True)
class Robustness:
    """Measure how success and lap time depend on each kind of randomisation, one after the other."""

    line_up: LineUp = field(default_factory=LineUp)
    episodes: int = 100
    """Races at every strength of each randomisation."""
    seed: int = 0
    """Seed of the starts and of the randomisation, which are never those of training."""
    png: Annotated[Path | None, described("FILE")] = None
    """Where to draw the figure (.png)."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def run(self) -> int:
        """Fly the races and print what they show."""
        check_output("--png", self.png, ".png")
        if self.line_up.randomise:
            raise CruiseError("robustness goes through all strengths by itself: leave out --randomise")
        if self.line_up.simulator != OUR_SIMULATOR:
            raise CruiseError("other simulators do not know what robustness changes: leave out --simulator")
        prepare_flight()
        from cruise.evaluation.robustness import measure_robustness  # noqa: PLC0415  (imports JAX)

        match = self.line_up.match()
        points = list(measure_robustness(match, self.episodes, self.seed))
        if self.png is not None:
            _draw(self.png, points, self._title(match))
        if self.json:
            print(json.dumps([_plain(point) for point in points], indent=2, allow_nan=False))
            return 0
        make_console().print(robustness_table(points, self._title(match)))
        if self.png is not None:
            print(f"figure   {self.png}")
        return 0

    def _title(self, match: "Match") -> str:
        drones, races = counted(len(match.team), "drone"), counted(self.episodes, "race")
        names = ", ".join(dict.fromkeys(pilot.name for pilot in match.team))
        return f"{names} ({match.vehicle.name}) on {match.track.name}: {drones}, {races} each"


def robustness_table(points: "list[Point]", title: str) -> Table:
    """One row per strength of each kind; 1.0 is the full randomisation."""
    numbers = (Column(name, justify="right") for name in ("strength", "value", "finished %", "flying lap [s]"))
    table = Table("what differs", *numbers, title=title)
    before = points[0].cell.kind
    for point in points:
        cell = point.cell
        if cell.kind != before:
            table.add_section()
        name = cell.kind.name if cell.strength else "nothing"
        value = f"{cell.value:+g} {cell.kind.unit}" if cell.kind.signed else f"{cell.value:g} {cell.kind.unit}"
        measured = (f"{100 * point.success_rate.mean:.1f}", number(point.flying_lap_time.mean))
        table.add_row(name, f"{cell.strength:g}", value if cell.strength else "", *measured)
        before = cell.kind
    return table


def _plain(point: "Point") -> dict[str, Any]:
    cell = point.cell
    what = {"what": cell.kind.name if cell.strength else "nothing", "strength": cell.strength}
    where = {"value": cell.value, "unit": cell.kind.unit}
    measured = {"success_rate": point.success_rate.to_dict(), "flying_lap_time": point.flying_lap_time.to_dict()}
    return what | where | measured


def _draw(path: Path, points: "list[Point]", title: str) -> None:
    from cruise.report.figure_style import to_png  # noqa: PLC0415  (imports Matplotlib, as the next does)
    from cruise.report.robustness_figure import draw_robustness  # noqa: PLC0415
    from cruise.storage.atomic import write_atomically  # noqa: PLC0415

    write_atomically(path, to_png(draw_robustness(points, title)))
