"""`cruise evaluate`: pilots measured over many races."""

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.table import Column, Table

from cruise.cli.compilation import prepare_flight
from cruise.cli.console import make_console
from cruise.cli.line_up import LineUp, described
from cruise.cli.outputs import check_output
from cruise.errors import CruiseError

if TYPE_CHECKING:
    from cruise.evaluation.statistics import Estimate
    from cruise.evaluation.summary import Evaluation
    from cruise.storage.race_log import RaceLog

USUAL_EPISODES = 100
MOST_SHOWN = 100  # races in a replay; more would make the page heavy


@dataclass(frozen=True)
class Evaluate:
    """Measure pilots over many races, with confidence intervals."""

    line_up: LineUp = field(default_factory=LineUp)
    episodes: Annotated[int | None, described("N")] = None
    """Races, each from a fresh random start. By default 100; with --protocol those of every field, or fewer of them."""
    laps: Annotated[int | None, described("N")] = None
    """Laps of each race. By default the track's, or the protocol's."""
    seed: int = 0
    """Seed of the starts, which are never those of training."""
    json: bool = False
    """Print one JSON object instead of a table."""
    protocol: Annotated[str | None, described("NAME")] = None
    """Measure as somebody else does, on their track from their starts: paper, uzh or lsy."""
    pool: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, described("NAME|PATH")] = ()
    """With --protocol uzh: random line-ups of four out of these pilots. Repeatable."""
    line_ups: Annotated[int | None, described("N")] = None
    """How many line-ups. By default those of the protocol."""
    html: Annotated[Path | None, described("FILE")] = None
    """Where to write a 3-D replay that steps through the races, the first 100 of more."""

    def run(self) -> int:
        """Fly the races and print what they show."""
        check_output("--html", self.html, ".html")
        if self.protocol is not None:
            return self._by_protocol(self.protocol)
        if self.pool or self.line_ups is not None:
            raise CruiseError("--pool and --line-ups belong to a protocol: give --protocol uzh")
        prepare_flight()
        from cruise.evaluation.matches import evaluate_match  # noqa: PLC0415  (imports JAX)

        shown: list[RaceLog] = []

        def keep(log: "RaceLog") -> None:
            if self.html is not None and len(shown) < MOST_SHOWN:
                shown.append(log)

        episodes = USUAL_EPISODES if self.episodes is None else self.episodes
        evaluation = evaluate_match(self.line_up.match(self.laps), episodes, self.seed, keep)
        self._write_replay(shown)
        if self.json:
            print(json.dumps(evaluation.to_dict(), indent=2, allow_nan=False))
            return 0
        console = make_console()
        console.print(measured_table(evaluation))
        if len(evaluation.pilots) > 1:
            console.print(pilot_table(evaluation))
        if self.html is not None:
            print(f"replay   {self.html}")
        return 0

    def _by_protocol(self, name: str) -> int:
        if self.laps is not None:
            raise CruiseError("--protocol says how many laps are flown: leave out --laps")
        if self.html is not None:
            raise CruiseError("--html shows races of one match, not those of a protocol: leave out one of them")
        from cruise.cli.protocol import find_protocol, run_protocol, show_rows  # noqa: PLC0415

        protocol = find_protocol(name, self.episodes)
        prepare_flight()
        show_rows(protocol, run_protocol(protocol, self.line_up, self.pool, self.line_ups, self.seed), self.json)
        return 0

    def _write_replay(self, logs: "list[RaceLog]") -> None:
        if self.html is None:
            return
        from cruise.viewer.page import write_replay  # noqa: PLC0415

        write_replay(self.html, logs, [f"race {number}" for number in range(1, len(logs) + 1)])


# What a row shows: its title, the field, the factor and the unit.
ROWS = (
    ("success, per drone", "success_rate", 100, "%"),
    ("success, all drones", "all_success_rate", 100, "%"),
    ("flying lap", "flying_lap_time", 1, "s"),
    ("flying lap, winner", "winner_lap_time", 1, "s"),
    ("first lap, from standing", "first_lap_time", 1, "s"),
    ("nominal lap, length / speed", "nominal_lap_time", 1, "s"),
    ("mean speed", "mean_speed", 1, "m/s"),
    ("top speed", "top_speed", 1, "m/s"),
    ("collisions per race", "collisions_per_race", 1, ""),
    ("missed gates per race", "missed_gates_per_race", 1, ""),
    ("overtakes per race", "overtakes_per_race", 1, ""),
)
BY_KIND_AFTER = "collisions_per_race"


def measured_table(evaluation: "Evaluation") -> Table:
    """Everything measured, collisions by kind among it."""
    numbers = (Column(title, justify="right") for title in ("mean", "std", "95 % interval"))
    drones, races = counted(evaluation.drones, "drone"), counted(evaluation.episodes, "race")
    title = f"{evaluation.policy} on {evaluation.track}: {drones}, {races}, seed {evaluation.seed}"
    table = Table("", *numbers, "", title=title)
    for name, key, factor, unit in ROWS:
        table.add_row(name, *cells(getattr(evaluation, key), factor), unit)
        for kind, estimate in evaluation.collisions_by_kind.items() if key == BY_KIND_AFTER else ():
            table.add_row(f"  {kind.removeprefix('collision_').replace('_', ' ')}", *cells(estimate, 1), style="dim")
    return table


def pilot_table(evaluation: "Evaluation") -> Table:
    """One row per pilot of a mixed field."""
    titles = ("drones", "won %", "success %", "flying lap [s]", "mean speed [m/s]", "gates")
    table = Table("pilot", *(Column(title, justify="right") for title in titles))
    for pilot in evaluation.pilots:
        shares = [f"{100 * rate.mean:.1f}" for rate in (pilot.win_rate, pilot.success_rate)]
        means = [number(e.mean) for e in (pilot.flying_lap_time, pilot.mean_speed, pilot.gates_passed)]
        table.add_row(pilot.name, str(pilot.drones), *shares, *means)
    return table


def cells(estimate: "Estimate", factor: float) -> tuple[str, str, str]:
    """Mean, deviation and interval."""
    mean, std, low, high = (number(factor * x) for x in (estimate.mean, estimate.std, estimate.low, estimate.high))
    return mean, std, "-" if math.isnan(estimate.low) else f"{low} .. {high}"


def counted(count: int, noun: str) -> str:
    """`1 race`, `2 races`."""
    return f"{count} {noun}{'s' * (count != 1)}"


def number(value: float) -> str:
    """Two decimals; a dash where nothing was measured."""
    return "-" if math.isnan(value) else f"{value:.2f}"
