"""`cruise race`: one race, its result, a picture and a log."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from cruise.cli.compilation import use_compilation_cache
from cruise.cli.line_up import LineUp, described
from cruise.errors import CruiseError

if TYPE_CHECKING:
    from cruise.evaluation.metrics import RaceResult
    from cruise.storage.race_log import RaceLog


@dataclass(frozen=True)
class Race:
    """Race policies against each other; print the result and draw it."""

    line_up: LineUp = field(default_factory=LineUp)
    laps: Annotated[int | None, described("N")] = None
    """Laps to fly. By default the track's."""
    seed: int = 0
    """Of the random start."""
    png: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = Path("race.png")
    """Where to draw the race. `--png None` draws nothing."""
    log: Annotated[Path | None, described("FILE")] = None
    """Where to write the race log (.npz; docs/race-log.md describes it)."""

    def run(self) -> int:
        """Fly the race, print the result table, write picture and log."""
        check_output("--png", self.png, ".png")
        check_output("--log", self.log, ".npz")
        use_compilation_cache()
        from cruise.evaluation.matches import run_races  # noqa: PLC0415  (imports JAX)
        from cruise.evaluation.metrics import race_result  # noqa: PLC0415
        from cruise.report.race_figure import draw_race  # noqa: PLC0415
        from cruise.storage.atomic import write_atomically  # noqa: PLC0415

        log = next(run_races(self.line_up.match(self.laps), 1, self.seed))
        picture = draw_race(log) if self.png is not None else b""
        if self.log is not None:
            log.save(self.log)
        if self.png is not None:
            write_atomically(self.png, picture)
        Console().print(result_table(log, race_result(log)))
        for name, path in (("picture", self.png), ("log", self.log)):
            if path is not None:
                print(f"{name:8} {path}")
        return 0


def check_output(flag: str, path: Path | None, ending: str) -> None:
    """Raises CruiseError where a file cannot be meant, before anything is flown for it."""
    if path is None:
        return
    if path.suffix != ending:
        raise CruiseError(f"{flag} must name a {ending} file, got {str(path)!r}")
    if path.is_dir():
        raise CruiseError(f"{flag} {path} is a folder")


def result_table(log: "RaceLog", result: "RaceResult") -> Table:
    """The drones, best first."""
    numbers = [Column(title, justify="right") for title in COLUMNS]
    laps = "1 lap" if log.laps == 1 else f"{log.laps} laps"
    table = Table(Column("", justify="right"), "drone", "pilot", *numbers, "", title=escape(f"{log.track}, {laps}"))
    for rank, drone in enumerate(result.ranking, start=1):
        mine = result.drones[drone]
        laps_flown = max(0, mine.gates_passed - 1) // log.num_gates
        measured = (f"{laps_flown}", seconds(mine.finish_time), seconds(mine.best_lap), f"{mine.top_speed:.2f} m/s")
        table.add_row(str(rank), str(drone + 1), escape(str(log.pilots[drone])), *measured, mine.fate)
    return table


COLUMNS = ("laps", "time", "best lap", "top speed")


def seconds(value: float) -> str:
    """A time for people; a dash where there is none."""
    return "-" if math.isnan(value) else f"{value:.2f} s"
