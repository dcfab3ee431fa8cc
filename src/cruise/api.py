"""The Python face of CRUISE: `import cruise`."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cruise.config import EXACT, InSimulator
from cruise.errors import CruiseError
from cruise.evaluation import matches
from cruise.evaluation.pilot_choice import PilotChoice
from cruise.evaluation.race_choices import (
    FleetChoice,
    RandomisationChoice,
    SensingChoice,
    TrackChoice,
    find_sensing,
    find_spread,
    find_track,
)
from cruise.evaluation.summary import Evaluation
from cruise.precision import single_precision
from cruise.racing.track_file import load_track
from cruise.storage.policy_file import load_policy
from cruise.storage.race_log import RaceLog
from cruise.viewer.page import write_replay

__all__ = ["evaluate", "load_policy", "load_track", "race", "replay"]


@single_precision
def race(  # noqa: PLR0913, PLR0917  (all that a race may be asked to be)
    track: TrackChoice = "ring",
    drones: int = 4,
    pilots: PilotChoice | Sequence[PilotChoice] | None = None,
    laps: int | None = None,
    seed: int = 0,
    vehicle: FleetChoice | InSimulator | None = None,
    randomise: RandomisationChoice = 0.0,
    sensing: SensingChoice = EXACT,
    spread_starts: float = 0.0,
) -> RaceLog:
    """Fly one race from a random standing start and give its log.

    Args:
        track: a track, the name of a built-in one, or the path of a TOML file.
        drones: how many race.
        pilots: a pilot for all drones, or one per drone, fewer taking turns: a name, the path of a policy or of an
            exported `.onnx` file, `file.py:Name`, or a function or class in Python. By default the policy shipped for
            this track and number of drones.
        laps: by default the track's.
        seed: the same seed gives the same race.
        vehicle: what all fly: a vehicle, the name of a built-in one, or the path of a TOML file; or several, one per
            drone, fewer taking turns. By default what the pilots were made for, or `paper`; they also fly another
            vehicle whose actions mean the same, if you ask so. `InSimulator("racer", "betaflight")` has it moved by
            another simulator, here by real firmware.
        randomise: how far the race differs from what vehicle and track say, as a share of `presets.RANDOMISATION`, or
            each spread: a `cruise.config.Randomisation`.
        sensing: what drones know of gates, opponents and themselves: `exact`, `range`, `camera`, or a `cruise.Sensing`.
        spread_starts: share of races that start all along a track which has a start of its own.

    Returns:
        The race as NumPy arrays; `log.save("race.npz")` keeps it.

    Raises:
        CruiseError: what was asked for does not exist or does not go together.
    """
    match = matches.make_match(find_track(track), drones, pilots, laps, vehicle=vehicle, randomise=randomise)
    match = replace(match, sensing=find_sensing(sensing), spread_starts=find_spread(spread_starts, match.track))
    return next(matches.run_races(match, 1, seed))


@single_precision
def evaluate(  # noqa: PLR0913, PLR0917  (as `race`)
    track: TrackChoice = "ring",
    drones: int = 4,
    pilots: PilotChoice | Sequence[PilotChoice] | None = None,
    episodes: int = 100,
    seed: int = 0,
    vehicle: FleetChoice | InSimulator | None = None,
    randomise: RandomisationChoice = 0.0,
    sensing: SensingChoice = EXACT,
    laps: int | None = None,
    spread_starts: float = 0.0,
) -> Evaluation:
    """Measure pilots over many races, each from a fresh random start.

    Args:
        track: as for `race`.
        drones: as for `race`.
        pilots: as for `race`.
        episodes: number of races.
        seed: of the starts, which differ from those of training for every seed.
        vehicle: as for `race`.
        randomise: as for `race`.
        sensing: as for `race`.
        laps: as for `race`.
        spread_starts: as for `race`.

    Returns:
        Success, lap times, speeds, collisions and overtakes, each with mean, standard deviation and 95 % interval;
        `to_dict()` is what `cruise evaluate --json` prints.

    Raises:
        CruiseError: what was asked for does not exist or does not go together.
    """
    match = matches.make_match(find_track(track), drones, pilots, laps, vehicle=vehicle, randomise=randomise)
    match = replace(match, sensing=find_sensing(sensing), spread_starts=find_spread(spread_starts, match.track))
    return matches.evaluate_match(match, episodes, seed)


def replay(
    logs: RaceLog | Sequence[RaceLog],
    path: str | os.PathLike[str] = "race.html",
    labels: Sequence[str] | None = None,
) -> Path:
    """Write a page that replays races in three dimensions, for any browser and without a network.

    Args:
        logs: a race, or several to step through.
        path: of the HTML file.
        labels: what tells each race from the others; by default `race 1`, `race 2` and so on.

    Returns:
        The path of the page.

    Raises:
        CruiseError: there is no race, there are not as many labels as races, or the file cannot be written.
    """
    races = [logs] if isinstance(logs, RaceLog) else list(logs)
    names = [f"race {number}" for number in range(1, len(races) + 1)] if labels is None else list(labels)
    if not races or len(names) != len(races):
        raise CruiseError(f"a replay needs at least one race and a label for each, got {len(races)} and {len(names)}")
    write_replay(Path(path), races, names)
    return Path(path)
