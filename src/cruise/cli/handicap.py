"""`cruise handicap`: how often a drone with more thrust gets past one with less, track by track."""

import dataclasses
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.table import Column, Table

from cruise.cli.compilation import prepare_flight
from cruise.cli.console import make_console
from cruise.cli.line_up import described
from cruise.errors import CruiseError
from cruise.presets import TRACKS
from cruise.racing.track_file import load_track
from cruise.vehicles import load_vehicle, reference_to

if TYPE_CHECKING:
    from cruise.evaluation.handicap import Handicap
    from cruise.evaluation.statistics import Estimate


@dataclass(frozen=True)
class MeasureHandicap:
    """Race a drone with more thrust against one with less, flown by the same pilot, and count who gets past whom."""

    thrust: float = 0.15
    """How much more the stronger one has, as a share."""
    track: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, described("NAME|FILE")] = ()
    """Built-in track, or path of a TOML file; repeat it for more. By default all built-in ones."""
    pilot: Annotated[str | None, described("NAME|PATH|FILE.py:NAME")] = None
    """Flies both. By default the policy shipped for two drones of the vehicle there, or else generalist."""
    vehicle: Annotated[str, described("NAME|FILE")] = "racer"
    """What the weaker one flies, with rotors."""
    episodes: int = 100
    """Races on each track."""
    seed: int = 0
    """Seed of the starts."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def run(self) -> int:
        """Fly the races and print what they show."""
        tracks, vehicle = [load_track(name) for name in self.track or TRACKS], load_vehicle(self.vehicle)
        prepare_flight()
        from cruise.evaluation.handicap import measure_handicap  # noqa: PLC0415  (imports JAX)

        found = []
        for track in tracks:
            pilot = self.pilot or _usual(track.name, reference_to(vehicle))
            found.append(measure_handicap(track, pilot, vehicle, self.thrust, self.episodes, self.seed))
        if self.json:
            print(json.dumps([_plain(one) for one in found], indent=2, allow_nan=False))
        else:
            make_console().print(handicap_table(found, f"{vehicle.name}: {100 * self.thrust:+g} % thrust against none"))
        return 0


def _usual(track: str, vehicle: Any) -> str:
    from cruise.storage.policy_file import GENERALIST, shipped_name  # noqa: PLC0415

    try:
        return shipped_name(track, 2, vehicle)
    except CruiseError:
        return GENERALIST


def handicap_table(found: "list[Handicap]", title: str) -> Table:
    """One row per track: of the stronger one, then of the weaker."""
    titles = ("behind", "got past %", "won %", "out %")
    columns = [Column(f"{who} {name}", justify="right") for who in ("stronger", "weaker") for name in titles]
    table = Table("track", "pilot", *columns, title=title)
    for one in found:
        cells = []
        for drone in (0, 1):
            cells.append(str(one.chances[drone]))
            cells.append(_share(one.passes[drone], interval=True))
            cells += [_share(one.won[drone]), _share(one.out[drone])]
        table.add_row(one.track, one.pilot, *cells)
    return table


def _share(estimate: "Estimate", interval: bool = False) -> str:
    if estimate.mean != estimate.mean:  # nobody was behind
        return "-"
    around = f" ({100 * estimate.low:.0f} to {100 * estimate.high:.0f})" if interval else ""
    return f"{100 * estimate.mean:.0f}{around}"


def _plain(one: "Handicap") -> dict[str, Any]:
    plain = dataclasses.asdict(one)
    return plain | {name: [x.to_dict() for x in getattr(one, name)] for name in ("passes", "won", "out")}
