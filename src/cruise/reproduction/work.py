"""What all jobs share: the folders, the scale, who made a result."""

import contextlib
import fcntl
import hashlib
import os
import platform
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax

from cruise import __version__
from cruise.errors import CruiseError
from cruise.pilots.se_ibr.settings import Setting, style_of
from cruise.presets import VEHICLES
from cruise.racing.track_file import load_track
from cruise.reproduction.commands import reproduce_command
from cruise.reproduction.plan import Job, Scale, config_of
from cruise.reproduction.results import Cell, Origin, ResultFolder
from cruise.storage.config_file import to_data, to_json


class Step(NamedTuple):
    """How far a job is."""

    doing: str  # training, measuring ...
    done: int = 0
    total: int = 0  # 0: not known


class Busy(CruiseError):
    """Another process runs this job."""


@dataclass(frozen=True)
class Work:
    """A study on disk: results that are kept, and runs that made them."""

    scale: Scale
    results: ResultFolder
    folder: Path  # of training runs and locks

    def run_folder(self, job: Job) -> Path:
        """Of a job's training. Another configuration gets another folder, so that no run goes on as something else."""
        digest = hashlib.sha256(to_json(config_of(job, self.scale)).encode()).hexdigest()[:8]
        return self.folder / f"{job.name}-{digest}"

    def origin(self, job: Job, started: float) -> Origin:
        """Who made a result, `started` at this time of `time.monotonic`."""
        return Origin(
            command=reproduce_command(job, self.scale),
            version=__version__,
            jax=jax.__version__,
            python=platform.python_version(),
            platform=f"{jax.default_backend()}, {os.cpu_count()} cores",
            scale=self.scale.name,
            seconds=round(time.monotonic() - started, 1),
        )

    @contextlib.contextmanager
    def lock(self, job: Job) -> Iterator[None]:
        """Keep other processes from running the same job. Raises Busy where one does."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with (self.folder / f"{job.name}.lock").open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise Busy("another process is running it") from None
            yield


PLANNERS: dict[str, Setting] = {"se-ibr": "paper", "se-ibr-tuned": "tuned"}
# Fields of a configuration that change nothing in what is learned.
IMMATERIAL = ("checkpoint_seconds",)
# Options since which every policy learns and sees otherwise, whatever their value.
ERAS = ("sparring_share",)


def settings_of(job: Job, scale: Scale) -> dict[str, Any]:
    """What a job's cell depends on beside the seeds: the resolved configuration, or how the planner flies a track."""
    if job.family == "planner":
        style = style_of(PLANNERS[job.kind], load_track(job.track), VEHICLES[scale.base(job.drones).vehicle])
        return {name: float(value) for name, value in style._asdict().items()}
    return to_data(config_of(job, scale))


def is_current(cell: Cell, job: Job, scale: Scale) -> bool:
    """Whether a cell was made with the settings that the plan has today.

    Fields that one of the two does not know are no difference: a program that has grown an option still knows the
    results from before, which had none. But for those that mark an era.
    """
    return _agree(cell.config, settings_of(job, scale))


def _agree(kept: dict[str, Any], planned: dict[str, Any]) -> bool:
    if any(key in planned and key not in kept for key in ERAS):
        return False
    shared = [key for key in kept if key in planned and key not in IMMATERIAL]
    return all(
        _agree(kept[key], planned[key]) if isinstance(kept[key], dict) else _plain(kept[key]) == _plain(planned[key])
        for key in shared
    )


def _plain(value: Any) -> Any:
    """Lists and tuples alike, as JSON has them."""
    return list(value) if isinstance(value, tuple) else value
