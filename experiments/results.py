"""What was measured, as small JSON files: one per job, whole or not at all, read strictly."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from cruise.errors import CruiseError
from cruise.storage.atomic import read_bytes, write_atomically
from cruise.storage.config_file import load_config, to_data
from experiments.plan import KINDS, Job

FORMAT = 1
CELLS, MEETINGS, POLICIES, RACES = "cells", "head_to_head", "policies", "races"  # folders below `results`

Numbers = tuple[float | None, ...]  # None where nothing was measured


@dataclass(frozen=True)
class Origin:
    """What made a result, so that it can be made again."""

    command: str
    version: str  # of this program
    jax: str
    python: str
    platform: str  # what JAX computed on
    scale: str  # full or quick
    seconds: float  # of wall time, on a machine that may have been shared


@dataclass(frozen=True)
class Measured:
    """Races of one pilot against itself, one number per race. Speeds and laps are means over the drones named."""

    seed: int  # of the starts
    drones: int
    success: tuple[float, ...]  # share of drones that finished
    speed: Numbers  # mean speed of drones that finished [m/s]
    air_speed: Numbers  # mean speed of all drones while in the air [m/s]
    lap: Numbers  # timed flying lap of drones that finished [s]
    first_lap: Numbers  # from standing [s]
    collisions: tuple[int, ...]
    overtakes: tuple[int, ...]
    fates: dict[str, int] = field(default_factory=dict)  # drones by how their race ended


@dataclass(frozen=True)
class StageResult:
    """The policy at the end of a phase of training, raced under the final rules with the agility of its stage."""

    stage: int
    name: str
    agility: float  # [m/s^2]
    measured: Measured


@dataclass(frozen=True)
class Curve:
    """A run's learning curve, thinned: rollouts averaged, the last evaluation of each stretch."""

    steps: tuple[int, ...]
    stage: tuple[int, ...]
    reward: Numbers  # per step
    speed: Numbers  # [m/s] in evaluations, as the next three
    success: Numbers  # share of evaluation races that the active drone survived
    lap: Numbers  # [s]
    win_rate: Numbers


@dataclass(frozen=True)
class Cell:
    """A kind of pilot measured on a track: one training seed, or one seed of races for a planner."""

    format: int
    kind: str
    track: str
    drones: int
    seed: int
    origin: Origin
    measured: Measured
    steps: int = 0  # of training
    training_seconds: float = 0.0
    training_command: str = ""
    config: dict[str, Any] = field(default_factory=dict)  # of the training, resolved; how a planner flies the track
    stages: tuple[StageResult, ...] = ()
    curve: Curve | None = None


@dataclass(frozen=True)
class Meeting:
    """Races of one line-up. `rank[r][i]` is the place of entrant i in race r, equal for a tie."""

    entrants: tuple[str, ...]  # kinds, one drone each
    rank: tuple[tuple[int, ...], ...]
    finish: tuple[Numbers, ...]  # finish times, None where it did not finish [s]
    crashed: tuple[tuple[bool, ...], ...]


@dataclass(frozen=True)
class HeadToHead:
    """All meetings of one track, number of drones and seed."""

    format: int
    track: str
    drones: int
    seed: int
    origin: Origin
    policies: dict[str, str]  # checksums of the learned entrants' parameters
    meetings: tuple[Meeting, ...]


T = TypeVar("T", Cell, HeadToHead)


@dataclass(frozen=True)
class ResultFolder:
    """Where results lie."""

    path: Path

    def file_of(self, job: Job) -> Path:
        """Of a job's result."""
        return self.path / (MEETINGS if job.family == "head-to-head" else CELLS) / f"{job.name}.json"

    def policy_of(self, job: Job) -> Path:
        """Of a learned job's policy, without ending."""
        return self.path / POLICIES / job.name

    def checksum_of(self, job: Job) -> str:
        """Of the policy that a learned job left; "" where it left none."""
        path = self.policy_of(job).with_name(f"{job.name}.safetensors")
        return hashlib.sha256(read_bytes(path, "policy")).hexdigest()[:16] if path.exists() else ""

    def race_of(self, job: Job) -> Path:
        """Of a race log kept for the pictures."""
        return self.path / RACES / f"{job.track}-{job.drones}-{job.kind}.npz"

    def read(self, job: Job) -> Cell | HeadToHead | None:
        """A job's result; None where there is none. Raises CruiseError where the file is not a sound one."""
        path = self.file_of(job)
        if not path.exists():
            return None
        return _read(path, HeadToHead, job) if job.family == "head-to-head" else _read(path, Cell, job)

    def write(self, job: Job, result: Cell | HeadToHead) -> None:
        """Keep a result: one line of JSON per field."""
        lines = (f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in to_data(result).items())
        write_atomically(self.file_of(job), ("{\n" + ",\n".join(lines) + "\n}\n").encode())


def _read(path: Path, kind: type[T], job: Job) -> T:
    result = load_config(path, kind, "result")
    where = f"result {path}"
    if result.format != FORMAT:
        raise CruiseError(f"{where}: format {result.format}, this program reads {FORMAT}")
    said = (getattr(result, "kind", job.kind), result.track, result.drones, result.seed)
    if said != (job.kind, job.track, job.drones, job.seed):
        raise CruiseError(f"{where}: holds another job than its name says: {Job(*said).name}")
    for measured in measurements(result):
        _check_measured(measured, where)
    for meeting in getattr(result, "meetings", ()):
        _check_meeting(meeting, where)
    return result


def measurements(result: Cell | HeadToHead) -> tuple[Measured, ...]:
    """Every evaluation in a result."""
    return (result.measured, *(stage.measured for stage in result.stages)) if isinstance(result, Cell) else ()


PER_RACE = ("success", "speed", "air_speed", "lap", "first_lap", "collisions", "overtakes")


def _check_measured(measured: Measured, where: str) -> None:
    lengths = {name: len(getattr(measured, name)) for name in PER_RACE}
    if len(set(lengths.values())) > 1 or lengths["success"] == 0:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise CruiseError(f"{where}: expected one number per race in every list, got {told}")
    if not all(0.0 <= share <= 1.0 for share in measured.success):
        raise CruiseError(f"{where}: success must be a share from 0 to 1")


def _check_meeting(meeting: Meeting, where: str) -> None:
    names = " against ".join(meeting.entrants)
    unknown = next((kind for kind in meeting.entrants if kind not in KINDS), None)
    if unknown is not None:
        raise CruiseError(f"{where}: unknown entrant {unknown!r}")
    lists: Sequence[Sequence[Sequence[Any]]] = (meeting.rank, meeting.finish, meeting.crashed)
    if len({len(races) for races in lists}) > 1 or not meeting.rank:
        raise CruiseError(f"{where}: {names}: rank, finish and crashed must have one entry per race")
    if any(len(row) != len(meeting.entrants) for races in lists for row in races):
        raise CruiseError(f"{where}: {names}: every race must have one entry per entrant")
