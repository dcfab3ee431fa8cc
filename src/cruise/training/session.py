"""A training run on disk: configuration, logs, checkpoints, policies; started, interrupted and resumed."""

import json
import os
import shlex
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import jax
import numpy as np
from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event, SessionLog
from tensorboardX.proto.summary_pb2 import Summary

from cruise import __version__
from cruise.config import Track, TrainConfig, Vehicle
from cruise.errors import CruiseError
from cruise.storage.atomic import write_atomically
from cruise.storage.checkpoint import CURRENT, load_checkpoint, save_checkpoint
from cruise.storage.config_file import load_config, save_config
from cruise.storage.policy_file import PolicyMeta, save_policy
from cruise.training import hosts
from cruise.training.beginning import first_state
from cruise.training.curriculum import Phase
from cruise.training.league import standing
from cruise.training.trainer import Progress, Trainer, TrainingDiverged
from cruise.training.types import TrainState

METRICS = "metrics.jsonl"
CONFIG = "config.json"
TENSORBOARD = "tensorboard"


class Interrupted(KeyboardInterrupt):
    """Ctrl-C: the run has been saved and can be resumed."""


class MetricsLog:
    """`metrics.jsonl` and TensorBoard, one row per update, cut back to the checkpoint when a run resumes.

    TensorBoard's events are written here and now: the library's own `SummaryWriter` hands them, number by number, to
    a thread that lags behind, and what it had not written when the process was killed would never be.
    """

    def __init__(self, folder: Path, updates: int) -> None:
        """Open both logs and drop rows after update number `updates`."""
        self.path = folder / METRICS
        kept = [row for row in read_metrics(folder) if row["update"] <= updates]
        write_atomically(self.path, "".join(json.dumps(row) + "\n" for row in kept).encode())
        self._file = self.path.open("a")
        (folder / TENSORBOARD).mkdir(exist_ok=True)
        self._board = EventsWriter(str(folder / TENSORBOARD / "events"), f".{time.time_ns()}")
        first = kept[-1]["steps"] + 1 if kept else 0  # TensorBoard forgets what older files hold from here on
        self._board.write_event(Event(step=first, session_log=SessionLog(status=SessionLog.START)))

    def add(self, row: dict[str, Any]) -> None:
        """Append one row; it reaches the disk at once."""
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()
        numbers = [Summary.Value(tag=k, simple_value=v) for k, v in row.items() if isinstance(v, float)]
        self._board.write_event(Event(wall_time=time.time(), step=row["steps"], summary=Summary(value=numbers)))

    def flush(self) -> None:
        """Bring to the disk what is still buffered: a run that resumes does not log it again."""
        self._board.flush()

    def close(self) -> None:
        """Flush and close both logs."""
        self._file.close()
        self._board.close()


def read_metrics(folder: Path) -> list[dict[str, Any]]:
    """Rows of a run's `metrics.jsonl`; a last line cut short by a crash is left out."""
    path = folder / METRICS
    rows = []
    for line in path.read_text().splitlines() if path.exists() else []:
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            break
    return rows


def metrics_row(progress: Progress, seconds: float) -> dict[str, Any]:
    """One update as plain numbers; a value that was not measured is absent."""
    row: dict[str, Any] = {
        "update": int(progress.state.updates),
        "steps": progress.steps,
        "stage": progress.phase.number,
        "seconds": round(seconds, 3),
    }
    row |= {name: float(value) for name, value in jax.device_get(progress.metrics).items()}
    row["policy/std"] = float(np.exp(np.asarray(progress.state.model.log_std)).mean())
    if progress.score is not None:
        score = {f"evaluation/{name}": value for name, value in progress.score._asdict().items()}
        row |= {name: value for name, value in score.items() if value is not None and np.isfinite(value)}
        row["evaluation/opponents_replaced"] = float(progress.opponents_replaced)
        if progress.state.league is not None:
            row |= {f"league/{name}": value for name, value in standing(progress.state.league).items()}
    return row


class _StopRequest:
    """Turns the first Ctrl-C into a flag that is looked at between updates; the second one acts at once."""

    def __init__(self) -> None:
        self.asked = False
        self._previous: Any = None

    def __enter__(self) -> "_StopRequest":
        try:
            self._previous = signal.signal(signal.SIGINT, self._ask)
        except ValueError:  # not the main thread: there is no signal to catch
            self._previous = None
        return self

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def __exit__(self, *_: object) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)


class Session:
    """One run in one folder. Iterate over it to train."""

    def __init__(
        self,
        folder: Path,
        config: TrainConfig,
        track: Track,
        vehicle: Vehicle,
        *,
        resume: bool = False,
        devices: Sequence[jax.Device] | None = None,
    ) -> None:
        """Open a folder: a new one, or with `resume` that of an earlier run, on whatever `devices` there are now.

        Raises:
            CruiseError: the folder holds a run already, or none to resume, or it cannot be written.
        """
        self.folder, self.config, self.track = folder, config, track
        self.trainer = Trainer(config, track, vehicle, devices)
        self.seconds_before = 0.0
        self.state = self._resume() if resume else self._begin()

    def _resume(self) -> TrainState:
        """The newest checkpoint, which the first process alone needs to have."""
        shape, state = self.trainer.state_shape(), None
        if hosts.is_first():
            state, meta = load_checkpoint(self.folder, shape)
            self.seconds_before = float(meta["seconds"])
        return hosts.from_first(state, shape)

    def _begin(self) -> TrainState:
        """A new run on disk. The configuration comes last: where there is one, there is a checkpoint to go on from."""
        if hosts.is_first() and os.path.exists(
            self.folder / CONFIG
        ):  # Path.exists raises where a folder may not be entered
            raise CruiseError(
                f"{self.folder} holds a run already: go on with {self.resume_command}, or choose another --out"
            )
        state = first_state(self.trainer)
        self._write_checkpoint(state, 0.0, 0)
        if hosts.is_first():
            save_config(self.folder / CONFIG, self.config)
        return state

    @property
    def resume_command(self) -> str:
        """What to type to go on with this run."""
        return f"cruise train --resume {shlex.quote(str(self.folder))}"

    def __iter__(self) -> Iterator[Progress]:
        """Train, log, save; yields after every update.

        Raises:
            Interrupted: after Ctrl-C, with everything saved.
            TrainingDiverged: a loss or a parameter stopped being finite; the last checkpoint is good.
        """
        started = saved = time.monotonic()
        log = MetricsLog(self.folder, int(self.state.updates)) if hosts.is_first() else None
        try:
            with _StopRequest() as stop:
                for progress in self.trainer.run(self.state):
                    self.state = progress.state
                    seconds = self.seconds_before + time.monotonic() - started
                    if log:
                        log.add(metrics_row(progress, seconds))
                    due = time.monotonic() - saved >= self.config.checkpoint_seconds
                    if progress.phase_ended or hosts.agreed(due):
                        if log:
                            log.flush()
                        self._save(progress, seconds)
                        saved = time.monotonic()
                    yield progress
                    if hosts.agreed(stop.asked):  # looked at last: it may have come while the caller showed the update
                        self._save(progress, seconds)
                        raise Interrupted(f"stopped after {progress.steps:,} steps; go on with: {self.resume_command}")
        except TrainingDiverged as error:
            raise TrainingDiverged(f"{error}; the last good checkpoint is {self.folder / CURRENT}") from None
        except jax.errors.JaxRuntimeError as error:
            if jax.process_count() == 1:
                raise
            reason = str(error).splitlines()[0]
            raise CruiseError(f"a process of this run was lost ({reason}); go on with: {self.resume_command}") from None
        finally:
            if log:
                log.close()

    def _save(self, progress: Progress, seconds: float) -> None:
        if progress.phase_ended and hosts.is_first():
            number = self.trainer.phases.index(progress.phase) + 1
            self._write_policy(f"stage-{number}", progress.phase, {})
        self._write_checkpoint(progress.state, seconds, progress.steps)

    def _write_checkpoint(self, state: TrainState, seconds: float, steps: int) -> None:
        state = hosts.whole(state)  # all processes must take part
        if hosts.is_first():
            save_checkpoint(self.folder, state, {"seconds": seconds, "steps": steps, "version": __version__})

    def finish(self, measure: Callable[[Path], dict[str, Any]]) -> Path:
        """Write the finished policy, then again with the results that `measure` finds for it; returns its path."""
        last = self.trainer.phases[-1]
        path = self._write_policy("policy", last, {})
        return self._write_policy("policy", last, measure(path))

    def _write_policy(self, stem: str, phase: Phase, results: dict[str, Any]) -> Path:
        meta = PolicyMeta(
            name=f"{self.folder.name}/{stem}",
            track=self.track.name,
            drones=self.config.drones,
            vehicle=self.config.vehicle,
            observation=self.config.observation,
            agility=phase.stage.agility,
            steps=int(self.state.updates) * self.trainer.steps_per_update,
            seed=self.config.seed,
            version=__version__,
            config=self.config,
            results=results,
        )
        return save_policy(self.folder / f"{stem}.safetensors", self.state.model, meta)


def default_folder(config: TrainConfig) -> Path:
    """Where a run goes when nobody says: `runs/TRACK-DRONES-sSEED`."""
    kind = "-vanilla" if config.vanilla else ""
    return Path("runs") / f"{Path(config.track).stem}-{config.drones}{kind}-s{config.seed}"


def resume_config(folder: Path) -> TrainConfig:
    """Configuration of an earlier run.

    Raises:
        CruiseError: when the folder holds none.
    """
    if not os.path.exists(folder / CONFIG):
        raise CruiseError(f"{folder}: no run to resume here, {CONFIG} is missing")
    return load_config(folder / CONFIG, TrainConfig)
