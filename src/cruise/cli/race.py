"""`cruise race`: races, their result, a picture, a replay and a log."""

import contextlib
import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from rich.table import Column, Table

from cruise.cli.compilation import prepare_flight
from cruise.cli.console import make_console
from cruise.cli.line_up import LineUp, described
from cruise.cli.outputs import Films, Outputs, show
from cruise.cli.watch import Watch
from cruise.errors import CruiseError

if TYPE_CHECKING:
    from cruise.evaluation.matches import Match
    from cruise.evaluation.metrics import RaceResult
    from cruise.storage.race_log import RaceLog
    from cruise.viewer.broadcast import Broadcast

PAUSE = 2.0  # between two races of a live view [s]
MAX_RACES = 1000


@dataclass(frozen=True)
class Race:
    """Race policies against each other; print the result and draw it."""

    line_up: LineUp = field(default_factory=LineUp)
    laps: Annotated[int | None, described("N")] = None
    """Laps to fly. By default the track's."""
    seed: int = 0
    """Seed of the random start."""
    races: Annotated[int | None, described("N")] = None
    """How many races, each from a random start of its own; the replay steps through them. By default 1, or with --watch
    one after the other until Ctrl-C."""
    outputs: Outputs = field(default_factory=Outputs)
    watch: Watch = field(default_factory=Watch)

    def run(self) -> int:
        """Fly the races, print the result, write what shows them."""
        self.outputs.check()
        races = self._count()
        prepare_flight()
        if self.watch.watch:
            return self._show_live()
        from cruise.evaluation.matches import run_races  # noqa: PLC0415  (imports JAX)
        from cruise.evaluation.metrics import race_result  # noqa: PLC0415

        logs = list(run_races(self.line_up.match(self.laps), races, self.seed))
        results = [race_result(log) for log in logs]
        products = self.outputs.write(logs, race_labels(self.seed, len(logs)))
        make_console().print(result_table(logs[0], results[0]) if len(logs) == 1 else races_table(logs[0], results))
        self.outputs.tell(products)
        return 0

    def _count(self) -> int:
        if self.races is not None and not 1 <= self.races <= MAX_RACES:
            raise CruiseError(f"--races must be from 1 to {MAX_RACES}, got {self.races}")
        return self.races or 1

    def _show_live(self) -> int:
        """Fly race after race for those who watch, and write nothing."""
        if self.outputs.log or self.outputs.films != Films():
            raise CruiseError("--watch shows races and writes nothing: leave out --log, --gif and --mp4")
        match = self.line_up.match(self.laps)
        title = f"{match.track.name}, {len(match.team)} drones"
        with self.watch.server(title) as server:
            if self.outputs.open:
                show(server.address)
            print("Ctrl-C ends it", flush=True)
            with contextlib.suppress(KeyboardInterrupt):
                show_races(server.broadcast, match, self.seed, self.races)
        return 0


def show_races(broadcast: "Broadcast", match: "Match", seed: int, races: int | None) -> None:
    """Publish a race when the one before has been seen, from seed to seed; after so many wait for Ctrl-C."""
    from cruise.evaluation.matches import run_races  # noqa: PLC0415
    from cruise.viewer.packing import pack_race  # noqa: PLC0415

    for number in itertools.count():
        if races is None or number < races:
            log = next(run_races(match, 1, seed + number))
            race = pack_race(log, f"seed {seed + number}")
            broadcast.publish("race", race)
            print(f"{race['label']}: {race['outcome']}", flush=True)
        time.sleep(race["duration"] + PAUSE)
        while not broadcast.wait_for_listener(1.0):
            pass


def race_labels(seed: int, races: int) -> list[str]:
    """What tells the races of one command apart."""
    return [f"seed {seed}"] if races == 1 else [f"race {race}" for race in range(1, races + 1)]


def result_table(log: "RaceLog", result: "RaceResult") -> Table:
    """The drones, best first."""
    numbers = [Column(title, justify="right") for title in COLUMNS]
    laps = "1 lap" if log.laps == 1 else f"{log.laps} laps"
    table = Table(Column("", justify="right"), "drone", "pilot", *numbers, "", title=f"{log.track}, {laps}")
    for rank, drone in enumerate(result.ranking, start=1):
        mine = result.drones[drone]
        laps_flown = max(0, mine.gates_passed - 1) // log.num_gates
        measured = (f"{laps_flown}", seconds(mine.finish_time), seconds(mine.best_lap), f"{mine.top_speed:.2f} m/s")
        table.add_row(str(rank), str(drone + 1), log.names[drone], *measured, mine.fate)
    return table


def races_table(log: "RaceLog", results: Sequence["RaceResult"]) -> Table:
    """Several races, one row each."""
    titles = ("race", "won by", "time", "best lap", "finished", "overtakes")
    laps = "1 lap" if log.laps == 1 else f"{log.laps} laps"
    title = f"{log.track}, {laps}, {log.num_drones} drones"
    table = Table(*(Column(name, justify="right") for name in titles), title=title)
    for race, result in enumerate(results, start=1):
        best = result.drones[result.ranking[0]]
        winner = f"drone {result.winner + 1}" if result.winner >= 0 else "nobody"
        lap = min((drone.best_lap for drone in result.drones if not math.isnan(drone.best_lap)), default=math.nan)
        finished = f"{sum(drone.finished for drone in result.drones)} of {len(result.drones)}"
        table.add_row(str(race), winner, seconds(best.finish_time), seconds(lap), finished, str(result.overtakes))
    return table


COLUMNS = ("laps", "time", "best lap", "top speed")


def seconds(value: float) -> str:
    """A time for people; a dash where there is none."""
    return "-" if math.isnan(value) else f"{value:.2f} s"
