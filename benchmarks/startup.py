"""Starting: fresh processes with an empty compilation cache and with a filled one, and the memory they take.

Run as a program, `python -m benchmarks.startup training | command ARGUMENT...`, this is such a process: it does what it
is told, then prints one line of JSON.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PATIENCE = 600.0  # with a process [s]


class Start(NamedTuple):
    """What a process that trains took."""

    total_s: float  # from its launch to the end of its first update
    compile_s: float  # of that, tracing and compiling, or loading what was compiled before
    peak_memory_mb: float  # after two updates


class CommandRun(NamedTuple):
    """What a `cruise` command took."""

    total_s: float  # from its launch to its end
    peak_memory_mb: float


def start_training(cache: Path) -> Start:
    """Start a process that trains, four drones on the ring, and keeps what it compiles in `cache`."""
    launched = time.time()
    told = _child(cache, "training")
    return Start(told["first_update_at"] - launched, told["compile_s"], told["peak_memory_mb"])


def run_command(cache: Path, *arguments: str) -> CommandRun:
    """Run `cruise ARGUMENTS` in a process of its own."""
    launched = time.time()
    told = _child(cache, "command", *arguments)
    return CommandRun(told["ended_at"] - launched, told["peak_memory_mb"])


def race_command(folder: Path, pilot: str) -> tuple[str, ...]:
    """`cruise race` with its picture in `folder`."""
    return "race", "--pilot", pilot, "--png", str(folder / "race.png")


def train_command(folder: Path) -> tuple[str, ...]:
    """`cruise train` from its first stage to its last picture, but a fiftieth of the steps."""
    return "train", "--out", str(folder / "run"), "--step-scale", "0.02"


def _child(cache: Path, *task: str) -> dict[str, Any]:
    kept = {name: value for name, value in os.environ.items() if "JAX_COMPILATION_CACHE" not in name}
    settings = kept | {"XDG_CACHE_HOME": str(cache), "MPLBACKEND": "agg", "TF_CPP_MIN_LOG_LEVEL": "3"}
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.startup", *task],
        cwd=ROOT,
        env=settings,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(task)} ended with {done.returncode}: {done.stderr.strip()[-2000:]}")
    told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return told


def _training() -> dict[str, float]:
    """Start as `cruise train` does, up to the first update; then once more, which compiles nothing."""
    from cruise.cli.compilation import prepare_training  # noqa: PLC0415  (imports are part of a start)

    prepare_training()
    from benchmarks.training import TrainingCase  # noqa: PLC0415
    from cruise.config import TrainConfig  # noqa: PLC0415

    before = time.perf_counter()
    case = TrainingCase(TrainConfig(drones=4))
    first, first_at = time.perf_counter() - before, time.time()
    before = time.perf_counter()
    case()
    second = time.perf_counter() - before
    return {"first_update_at": first_at, "compile_s": first - second} | _peak()


def _command(arguments: list[str]) -> dict[str, float]:
    from cruise.cli.main import main  # noqa: PLC0415

    code = main(arguments)
    if code:
        sys.exit(code)
    return {"ended_at": time.time()} | _peak()


def _peak() -> dict[str, float]:
    from benchmarks.machine import peak_memory_mb  # noqa: PLC0415

    return {"peak_memory_mb": peak_memory_mb()}


def _main(task: str, *arguments: str) -> None:
    told = _training() if task == "training" else _command(list(arguments))
    print(json.dumps(told))


if __name__ == "__main__":
    _main(*sys.argv[1:])
