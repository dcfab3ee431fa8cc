"""`cruise racecraft`: what a pilot makes of situations with known answers."""

import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Column, Table

from cruise.cli.compilation import prepare_flight
from cruise.cli.console import make_console
from cruise.cli.evaluate import counted
from cruise.cli.line_up import described, usual_track
from cruise.cli.outputs import Product, check_output, name, write
from cruise.racing.track_file import load_track

if TYPE_CHECKING:
    from cruise.config import Track
    from cruise.evaluation.racecraft import Outcome


@dataclass(frozen=True)
class Racecraft:
    """Fly a pilot through situations with known answers: passes made, time lost, contacts and whose fault they were."""

    pilot: Annotated[str | None, described("NAME|PATH|FILE.py:NAME")] = None
    """Who is measured: a shipped policy, a .safetensors file or the folder of a run, an exported .onnx file, one of
    chaser, hover, se-ibr and se-ibr-tuned, or a pilot of your own in Python. By default the policy shipped for track
    and vehicle."""
    track: Annotated[str | None, described("NAME|FILE")] = None
    """Built-in track, or path of a TOML file. By default the one the policy was trained on, or ring."""
    vehicle: Annotated[str | None, described("NAME|FILE")] = None
    """What all drones fly. By default what the pilot was made for, or paper."""
    runs: int = 40
    """Runs of every scenario, each from a start of its own."""
    seed: int = 0
    """Seed of the starts."""
    json: bool = False
    """Print one JSON object instead of a table."""
    html: Annotated[Path | None, described("FILE")] = None
    """Where to write a 3-D replay of one run of every scenario, and of one with a contact where there is any."""
    png: Annotated[Path | None, described("FILE")] = None
    """Where to draw one run of every scenario."""

    def run(self) -> int:
        """Fly the scenarios and print what they show."""
        check_output("--html", self.html, ".html")
        check_output("--png", self.png, ".png")
        prepare_flight()
        from cruise.evaluation.pilot_choice import pilot_meta  # noqa: PLC0415  (imports JAX, as the next does)
        from cruise.evaluation.racecraft import measure_racecraft  # noqa: PLC0415

        pilot, vehicle = self.pilot, self.vehicle
        meta = None if pilot is None else pilot_meta(pilot)
        track = load_track(self.track) if self.track is not None else usual_track(meta)
        outcomes = measure_racecraft(track, pilot, self.runs, self.seed, vehicle)
        flown_by = str(outcomes[0].runs[0].log.pilots[0])
        title = f"{flown_by} on {track.name}: {counted(self.runs, 'run')} each, seed {self.seed}"
        products = self._products(outcomes, title)
        write(products)
        if self.json:
            print(json.dumps(told(outcomes, flown_by, track, self.seed), indent=2, allow_nan=False))
            return 0
        make_console().print(racecraft_table(outcomes, title))
        name(products)
        return 0

    def _products(self, outcomes: "list[Outcome]", title: str) -> list[Product]:
        from cruise.report.racecraft_figure import draw_racecraft, typical_run  # noqa: PLC0415  (imports Matplotlib)
        from cruise.viewer.page import replay_page  # noqa: PLC0415

        products = []
        if self.html is not None:
            shown = [(outcome.scenario.name, typical_run(outcome)) for outcome in outcomes]
            for outcome in outcomes:
                touched = [run for run in outcome.runs if run.contacts]
                shown += [(f"{outcome.scenario.name}, a contact", run) for run in touched[:1]]
            logs, labels = [run.log for _, run in shown], [label for label, _ in shown]
            products.append(Product("replay", self.html, functools.partial(replay_page, logs, labels)))
        if self.png is not None:
            products.append(Product("picture", self.png, functools.partial(draw_racecraft, outcomes, title)))
        return products


COLUMNS = (  # title, quantity, factor and decimals
    ("good %", "good", 100, 0),
    ("finished %", "finished", 100, 0),
    ("first %", "first", 100, 0),
    ("passes", "passes", 1, 2),
    ("lost", "places_lost", 1, 2),
    ("time lost", "time_lost", 1, 2),
    ("contacts", "contacts", 1, 2),
    ("fault", "fault", 1, 2),
)


def racecraft_table(outcomes: "list[Outcome]", title: str) -> Table:
    """One row per scenario; means over its runs: places lost, time lost, the pilot's contacts and its fault in them."""
    table = Table(
        Column("scenario", no_wrap=True), *(Column(heading, justify="right") for heading, *_ in COLUMNS), title=title
    )
    for outcome in outcomes:
        measured = outcome.measured
        cells = (
            f"{factor * measured[key].mean:.{decimals}f}".replace("nan", "-") for _, key, factor, decimals in COLUMNS
        )
        table.add_row(outcome.scenario.name, *cells)
    return table


def told(outcomes: "list[Outcome]", pilot: str, track: "Track", seed: int) -> dict[str, object]:
    """The object that `--json` prints."""
    return {"pilot": pilot, "track": track.name, "seed": seed, "scenarios": [outcome.to_dict() for outcome in outcomes]}
