"""What all jobs share: the folders, the scale, who made a result."""

import contextlib
import hashlib
import os
import platform
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax

from cruise import __version__
from cruise.storage.config_file import to_json
from cruise.storage.file_lock import locked
from experiments.commands import reproduce_command
from experiments.plan import Job, Scale, config_of
from experiments.results import Origin, ResultFolder


class Step(NamedTuple):
    """How far a job is."""

    doing: str  # training, measuring ...
    done: int = 0
    total: int = 0  # 0: not known


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
        with locked(self.folder / f"{job.name}.lock"):
            yield
