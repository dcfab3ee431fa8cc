"""`cruise tune-planner`: how fast the SE-IBR planner can fly a track, found by racing."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cruise import __version__
from cruise.cli.compilation import prepare_flight
from cruise.cli.line_up import described
from cruise.errors import CruiseError
from cruise.racing.track_file import load_one_track
from cruise.vehicles import load_vehicle

if TYPE_CHECKING:
    from cruise.evaluation.planner_search import Candidate, Effort, Progress

USUAL_VEHICLE = "paper"


@dataclass(frozen=True)
class TunePlanner:
    """Find the speed, acceleration, margin and lead with which SE-IBR laps a track fastest and loses nobody."""

    track: Annotated[str, described("NAME|FILE")] = "ring"
    """Built-in track, or path of a TOML file."""
    vehicle: Annotated[str, described("NAME|FILE")] = USUAL_VEHICLE
    """Built-in vehicle, or path of a TOML file: what the planner flies."""
    out: Annotated[Path, described("FILE")] = Path("se-ibr-tuned.json")
    """Where to write what was found; what the file says of other tracks is kept. A file is of one vehicle."""
    seed: int = 0
    """Of the styles tried and of the starts."""
    quick: bool = False
    """Look less closely: for a first idea."""

    def run(self) -> int:
        """Search, say how it goes, and write the best. Stopped before its end, it writes nothing."""
        track = load_one_track(self.track)
        vehicle = load_vehicle(self.vehicle)
        kept = read_kept(self.out, vehicle.name)
        prepare_flight()
        from cruise.evaluation.planner_search import Effort, search  # noqa: PLC0415  (imports JAX)
        from cruise.storage.atomic import write_atomically  # noqa: PLC0415

        if not 0 <= self.seed < 2**31:
            raise CruiseError(f"seed must be from 0 to {2**31 - 1}, got {self.seed}")
        effort = Effort(2, 16, 4, 1, 12) if self.quick else Effort()
        print(f"tuning SE-IBR on {track.name} with {vehicle.name}: {effort.stages} stages", flush=True)
        began = time.monotonic()
        for progress in search(track, effort, self.seed, vehicle):
            print(progress_line(progress, effort, time.monotonic() - began), flush=True)
        found = entry(progress.best, effort, self.seed) | {"vehicle": vehicle.name}
        write_atomically(self.out, as_json(kept | {track.name: found}).encode())
        print(f"written  {self.out}")
        return 0


def progress_line(progress: "Progress", effort: "Effort", seconds: float) -> str:
    """A stage and the best style so far."""
    best = progress.best
    numbers = "  ".join(
        f"N={drones} success {100 * score.success:.1f} % lap {score.flying_lap:.2f} s {score.mean_speed:.2f} m/s"
        for drones, score in best.scores.items()
    )
    style = ", ".join(f"{name} {value:g}" for name, value in best.style._asdict().items())
    return f"{progress.stage}/{effort.stages}  {progress.what}, {seconds:.0f} s\n     {style}\n     {numbers}"


def entry(best: "Candidate", effort: "Effort", seed: int) -> dict[str, Any]:
    """What the file says of a track."""
    measured = {str(drones): score._asdict() for drones, score in best.scores.items()}
    how = {"races": effort.final_races, "seed": seed, "version": __version__}
    return {"style": best.style._asdict(), "measured": measured, **how}


def read_kept(path: Path, vehicle: str) -> dict[str, Any]:
    """What a file says of tracks; nothing where there is no file.

    Raises:
        CruiseError: it is something else, or of another vehicle.
    """
    if not path.exists():
        return {}
    from cruise.pilots.se_ibr.settings import read_tuned  # noqa: PLC0415  (imports JAX)

    read_tuned(path)
    kept: dict[str, Any] = json.loads(path.read_bytes())["tracks"]
    others = {entry.get("vehicle", USUAL_VEHICLE) for entry in kept.values()} - {vehicle}
    if others:
        raise CruiseError(f"{path} is of vehicle {min(others)!r}, not {vehicle!r}: give another file with --out")
    return kept


def as_json(tracks: dict[str, Any]) -> str:
    """The file, tracks by name."""
    return json.dumps({"tracks": dict(sorted(tracks.items()))}, indent=2, allow_nan=False) + "\n"
