"""What a training run logs: one row per update, in `metrics.jsonl` and for TensorBoard."""

import contextlib
import json
import os
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from tensorboardX.event_file_writer import EventsWriter
from tensorboardX.proto.event_pb2 import Event, SessionLog
from tensorboardX.proto.summary_pb2 import Summary

from cruise.storage.atomic import make_folder, read_bytes, write_atomically, writing
from cruise.training.league import standing
from cruise.training.trainer import Progress

METRICS = "metrics.jsonl"
TENSORBOARD = "tensorboard"


class MetricsLog:
    """`metrics.jsonl` and TensorBoard, one row per update, cut back to the checkpoint when a run resumes.

    TensorBoard's events are written here and now: the library's own `SummaryWriter` hands them, number by number, to
    a thread that lags behind, and what it had not written when the process was killed would never be.
    """

    def __init__(self, folder: Path, updates: int) -> None:
        """Open both logs and drop rows after update number `updates`. Raises CruiseError as the others do."""
        self.path = folder / METRICS
        kept = [row for row in read_metrics(folder) if row["update"] <= updates]
        write_atomically(self.path, "".join(json.dumps(row) + "\n" for row in kept).encode())
        make_folder(folder / TENSORBOARD)
        first = kept[-1]["steps"] + 1 if kept else 0  # TensorBoard forgets what older files hold from here on
        with writing(self.path):
            self._file = self.path.open("ab", buffering=0)
            self._board = EventsWriter(str(folder / TENSORBOARD / "events"), f".{time.time_ns()}")
            self._board.write_event(Event(step=first, session_log=SessionLog(status=SessionLog.START)))

    def add(self, row: dict[str, Any]) -> None:
        """Append one row, whole; it reaches the disk at once. Raises CruiseError where that fails."""
        numbers = [Summary.Value(tag=k, simple_value=v) for k, v in row.items() if isinstance(v, float)]
        with writing(self.path):
            self._append((json.dumps(row) + "\n").encode())
            self._board.write_event(Event(wall_time=time.time(), step=row["steps"], summary=Summary(value=numbers)))

    def _append(self, line: bytes) -> None:
        size = os.fstat(self._file.fileno()).st_size
        try:
            while line:
                line = line[self._file.write(line) :]
        except OSError:
            with contextlib.suppress(OSError):
                self._file.truncate(size)
            raise

    def flush(self) -> None:
        """Bring to the disk what is still buffered: a run that resumes does not log it again.

        Raises CruiseError where that fails.
        """
        with writing(self.path):
            self._board.flush()

    def close(self) -> None:
        """Flush and close both logs. What cannot be written any more is lost: it was told before, or is not missed."""
        self._file.close()
        with contextlib.suppress(OSError):
            self._board.close()


def read_metrics(folder: Path) -> list[dict[str, Any]]:
    """Rows of a run's `metrics.jsonl`; a last line cut short by a crash is left out."""
    path = folder / METRICS
    rows = []
    for line in read_bytes(path, "log").splitlines() if os.path.exists(path) else []:
        try:
            rows.append(json.loads(line))
        except ValueError:
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
