"""Best laps of people: a small file, and the flights themselves as ghosts."""

import dataclasses
import hashlib
import itertools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cruise.config import Track
from cruise.errors import CruiseError
from cruise.evaluation.metrics import events_of
from cruise.racing.events import EventKind
from cruise.storage.atomic import read_bytes, write_atomically
from cruise.storage.race_log import RaceLog, load_race_log
from cruise.viewer.samples import pack_samples

FILE, VERSION = "board.json", 1
KEPT = 10  # laps of a track and a vehicle


class Lap(NamedTuple):
    """From the first gate to the first gate."""

    drone: int
    start: float  # [s]
    time: float  # [s]


@dataclass(frozen=True)
class BestLap:
    """A row of the board."""

    track: str
    gates: str  # what tells tracks of one name apart
    vehicle: str
    time: float  # [s]
    name: str
    mode: str
    when: str
    log: str  # file beside the board
    drone: int
    start: float  # in that log [s]


def laps_of(log: RaceLog, drone: int) -> list[Lap]:
    """All laps that a drone completed, the standing one without its start."""
    ends = events_of(log, EventKind.CROSSING, drone)[:: log.num_gates].tolist()
    return [Lap(drone, start, end - start) for start, end in itertools.pairwise(ends)]


def best_of(log: RaceLog) -> Lap | None:
    """The fastest lap of a race."""
    return min((lap for d in range(log.num_drones) for lap in laps_of(log, d)), key=lambda lap: lap.time, default=None)


def ghost_of(log: RaceLog, lap: Lap) -> dict[str, Any]:
    """A lap as the page flies it along: samples whose clock starts in the plane of the first gate."""
    first, last = np.searchsorted(log.time, [lap.start, lap.start + lap.time])
    flown = slice(max(int(first) - 1, 0), int(last) + 1)
    states = (array[flown, lap.drone] for array in (log.position_w, log.velocity_w, log.euler))
    return {"time": round(lap.time, 4), "samples": pack_samples(log.time[flown] - lap.start, *states)}


class Board:
    """The best laps by track and vehicle, in a folder that holds the logs of their races."""

    def __init__(self, folder: Path, track: Track, vehicle: str) -> None:
        """Raises CruiseError where there is a board that cannot be read."""
        self.folder, self.path = folder, folder / FILE
        self.track, self.vehicle, self.gates = track.name, vehicle, gates_key(track)
        self.laps = self._read()

    @property
    def here(self) -> list[BestLap]:
        """Of this track and this vehicle, best first."""
        return [lap for lap in self.laps if (lap.gates, lap.vehicle) == (self.gates, self.vehicle)]

    def add(self, log: RaceLog, file: str, mode: str, when: str, drone: int) -> bool:
        """Enter the best lap of a drone that a person flew; whether it is the best here.

        Raises:
            CruiseError: the board cannot be read any more, or not be written.
        """
        lap = min(laps_of(log, drone), key=lambda one: one.time, default=None)
        if lap is None:
            return False
        name = str(log.pilots[drone])
        entry = BestLap(
            *(self.track, self.gates, self.vehicle, round(lap.time, 4)), name, mode, when, file, drone, lap.start
        )
        self.laps = self._read()  # another process may have written it
        others = [other for other in self.laps if other not in self.here]
        mine = sorted([*self.here, entry], key=lambda one: one.time)[:KEPT]
        self.laps = others + mine
        rows = [dataclasses.asdict(one) for one in self.laps]
        write_atomically(self.path, json.dumps({"version": VERSION, "laps": rows}, indent=1).encode())
        return mine[0] == entry

    def ghost(self) -> dict[str, Any] | None:
        """The best lap here, if the log of its race is still there and sound."""
        best = next(iter(self.here), None)
        if best is None or Path(best.log).name != best.log:
            return None
        try:
            log = load_race_log(self.folder / best.log)
            return ghost_of(log, Lap(best.drone, best.start, best.time)) if best.drone < log.num_drones else None
        except CruiseError:
            return None

    def _read(self) -> list[BestLap]:
        if not self.path.exists():
            return []
        try:
            content = json.loads(read_bytes(self.path, "board of best laps"))
            assert content["version"] == VERSION
            laps = [BestLap(**row) for row in content["laps"]]
            return sorted(laps, key=lambda lap: float(lap.time))
        except (AssertionError, KeyError, TypeError, ValueError):
            raise CruiseError(f"{self.path} is no board of best laps of version {VERSION}: move it away") from None


def gates_key(track: Track) -> str:
    """Tells tracks whose gates stand elsewhere apart, whatever their names."""
    told = repr(track.gates).replace(", motion=None", "")  # as keys were made before gates could move
    return hashlib.sha256(told.encode()).hexdigest()[:12]
