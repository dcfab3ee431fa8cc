"""`cruise tune`: search for the settings of training, reward weights included."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from cruise.cli.compilation import prepare_training
from cruise.cli.line_up import described
from cruise.errors import CruiseError
from cruise.presets import training_config
from cruise.racing.track_file import load_track
from cruise.vehicles import load_vehicle

MAX_TRIALS = 100_000


def prepare_worker() -> None:
    """One core for each trial: others train beside it."""
    prepare_training(1)


@dataclass(frozen=True)
class Tune:
    """Search for the settings of training by Ray Tune: laps and crashes decide, over several tracks and seeds."""

    track: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, described("NAME|FILE")] = ()
    """Built-in track, or path of a TOML file; by default ring. Repeatable: a setting must be good on all of them."""
    vehicle: Annotated[str, described("NAME|FILE")] = "racer"
    """Built-in vehicle, or path of a TOML file."""
    drones: int = 1
    """Drones per race."""
    seeds: int = 1
    """Trainings on every track, with seeds from 0."""
    step_scale: float = 0.25
    """Multiplies the training steps of every stage."""
    samples: int = 16
    """Settings tried; the first is the defaults as they are."""
    rungs: int = 4
    """Times that a trial is looked at while it trains, and may be stopped."""
    scheduler: Literal["asha", "pbt"] = "asha"
    """asha: stop the worst early; pbt: the worst go on from copies of the best, with other settings."""
    only: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, described("FIELD")] = ()
    """Search this setting alone, by its name in config.json. Repeatable; without it all of them."""
    at_once: Annotated[int | None, described("N")] = None
    """Trials at once, each on one core; by default as many as there are cores."""
    address: Annotated[str | None, described("HOST:PORT|auto")] = None
    """Head of a Ray cluster; without it this machine alone. All its machines must see the folder."""
    out: Path = Path("runs/tune")
    """Folder of the search: every trial, its checkpoints, trials.jsonl and best.json."""
    resume: bool = False
    """Go on with the search in that folder; give the other flags as they were."""

    def run(self) -> int:
        """Search, and print the best settings as flags of `cruise train`."""
        from cruise.training.tuner import BEST, best_of, find_recipe, search_space  # noqa: PLC0415  (imports JAX)
        from cruise.training.tuning import Search  # noqa: PLC0415
        from cruise.training.validation import check_config  # noqa: PLC0415

        for name in ("drones", "seeds", "samples", "rungs"):
            if not 1 <= getattr(self, name) <= MAX_TRIALS:
                raise CruiseError(f"--{name} must be between 1 and {MAX_TRIALS}, not {getattr(self, name)}")
        search_space(self.only)
        config = dataclasses.replace(
            training_config(load_vehicle(self.vehicle), self.drones), step_scale=self.step_scale
        )
        tracks = self.track or ("ring",)
        for track in tracks:
            load_track(track)
        check_config(config)
        search = Search(config, tracks, tuple(range(self.seeds)), self.rungs, self.samples, self.scheduler)
        found = find_recipe(
            search,
            self.out,
            self.only,
            prepare_worker,
            address=self.address,
            at_once=self.at_once,
            resume=self.resume,
        )
        for one in found[:10]:
            print(f"cost {one.told['cost']:.3f}  after {one.rungs} of {self.rungs}  {one.settings}")
        print(f"best     cruise train {best_of(search, found) or '(the defaults)'}\nrecord   {self.out / BEST}")
        return 0
