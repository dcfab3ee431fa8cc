"""A training run on disk: configuration, logs, checkpoints, policies; started, interrupted and resumed."""

import os
import shlex
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import jax

from cruise import __version__
from cruise.config import Track, TrainConfig, Vehicle
from cruise.errors import CruiseError
from cruise.pilots.terms_file import LOADED
from cruise.storage.atomic import make_folder
from cruise.storage.checkpoint import CURRENT, load_checkpoint, save_checkpoint
from cruise.storage.config_file import load_config, save_config, to_json
from cruise.storage.file_lock import Busy, hold, release
from cruise.storage.policy_file import PolicyMeta, read_meta, save_policy
from cruise.training import hosts
from cruise.training.curriculum import Phase
from cruise.training.initial_state import initial_state
from cruise.training.metrics_log import MetricsLog, metrics_row
from cruise.training.run_track import check_track, keep_track
from cruise.training.trainer import Progress, Trainer, TrainingDiverged
from cruise.training.types import TrainState

CONFIG = "config.json"
LOCK = "run.lock"


class Interrupted(KeyboardInterrupt):
    """Ctrl-C: the run has been saved and can be resumed."""


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
    """One run in one folder. Iterate over it to train.

    No other process can run in that folder until this one calls `close` or ends.
    """

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
            CruiseError: the folder holds a run already, or none to resume, or it cannot be written; another process
                runs in it; or the run is resumed on another track.
        """
        self.folder, self.config, self.track = folder, config, track
        self.trainer = Trainer(config, track, vehicle, devices)
        self.seconds_before, self.steps_before = 0.0, 0
        hosts.must_share("configuration or track", (to_json(config) + to_json(track)).encode())
        self._track_checksum = ""
        self.state = self._resume() if resume else self._begin()

    def _resume(self) -> TrainState:
        """The newest checkpoint, which the first process alone needs to have."""
        shape = self.trainer.state_shape()
        return hosts.from_first(hosts.on_first(lambda: self._load(shape)), shape)

    def _load(self, shape: TrainState) -> TrainState:
        self._hold()
        state, meta = load_checkpoint(self.folder, shape)
        self._track_checksum = check_track(self.folder, self.track, meta.get("track_sha256"))
        self.seconds_before, self.steps_before = float(meta["seconds"]), int(meta.get("steps_before", 0))
        return state

    def _begin(self) -> TrainState:
        """A new run on disk. The configuration comes last: where there is one, there is a checkpoint to go on from."""
        hosts.on_first(lambda: must_be_new(self.folder))
        state = initial_state(self.trainer)
        if self.config.start_from:
            self.steps_before = read_meta(self.config.start_from).all_steps
        hosts.on_first(self._take_folder)
        self._write_checkpoint(state, 0.0, 0)
        hosts.on_first(lambda: save_config(self.folder / CONFIG, self.config))
        return state

    def _take_folder(self) -> None:
        """Nothing is written before everything else is known to be right."""
        make_folder(self.folder)
        self._hold()
        must_be_new(self.folder)  # still: another process may have been faster
        self._track_checksum = keep_track(self.folder, self.track)

    def _hold(self) -> None:
        try:
            hold(self.folder / LOCK)
        except Busy:
            raise Busy(f"another process is training in {self.folder}: wait for it, or choose another --out") from None

    def close(self) -> None:
        """Let other processes have the folder."""
        release(self.folder / LOCK)

    @property
    def resume_command(self) -> str:
        """What to type to go on with this run."""
        return _resume_command(self.folder)

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
        except (jax.errors.JaxRuntimeError, ValueError) as error:  # JAX raises either, by where it waits for the other
            if jax.process_count() == 1 or (isinstance(error, ValueError) and "Gloo" not in str(error)):
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
            told = {"seconds": seconds, "steps": steps, "steps_before": self.steps_before, "version": __version__}
            save_checkpoint(self.folder, state, told | {"track_sha256": self._track_checksum})

    def finish(self, measure: Callable[[Path], dict[str, Any]]) -> Path:
        """Write the finished policy, then again with the results that `measure` finds for it; returns its path."""
        last = self.trainer.phases[-1]
        path = self._write_policy("policy", last, {})
        return self._write_policy("policy", last, measure(path))

    def _write_policy(self, stem: str, phase: Phase, results: dict[str, Any]) -> Path:
        meta = PolicyMeta(
            name=f"{self.folder.absolute().name}/{stem}",
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
            steps_before=self.steps_before,
            flown_on=None if self.track.variants else self.track,
            layout=self.trainer.env.layout(self.config.observation),
        )
        return save_policy(self.folder / f"{stem}.safetensors", self.state.policy, meta)


def must_be_new(folder: Path) -> None:
    """Raises CruiseError where a folder holds a run."""
    if os.path.exists(folder / CONFIG):  # Path.exists raises where a folder may not be entered
        raise CruiseError(
            f"{folder} holds a run already: go on with {_resume_command(folder)}, or choose another --out"
        )


def _resume_command(folder: Path) -> str:
    terms = "".join(f" --terms {shlex.quote(name)}" for name in LOADED)
    return f"cruise train --resume {shlex.quote(str(folder))}{terms}"


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
