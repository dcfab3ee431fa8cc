"""`python -m benchmarks`: measure, then print a table or one JSON object."""

import json
import math
import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import tyro
from rich.console import Console

from benchmarks.headline import FULL, QUICK, headline
from benchmarks.report import show
from benchmarks.sweeps import sweep
from cruise.cli.compilation import prepare_training


@dataclass(frozen=True)
class Benchmarks:
    """How fast CRUISE is on this machine. docs/performance.md defines every figure."""

    quick: bool = False
    """The headline alone, within 50 s on two idle cores."""
    json: bool = False
    """Print one JSON object instead of tables."""

    def run(self) -> None:
        """Measure with a compilation cache that is empty at first and thrown away at the end; print."""
        started = time.monotonic()
        effort = QUICK if self.quick else FULL
        with tempfile.TemporaryDirectory(prefix="cruise-benchmarks-") as folder:
            cache = Path(folder)
            _compile_into(cache)
            figures: dict[str, Any] = headline(effort, cache, say)
            if not self.quick:
                figures["tables"] = sweep(effort, say)
        figures["seconds"] = time.monotonic() - started
        if self.json:
            print(json.dumps(rounded(figures), indent=2, allow_nan=False))
        else:
            show(figures, Console())


def _compile_into(cache: Path) -> None:
    """Keep compiled programs where the processes started by `benchmarks.startup` keep theirs."""
    os.environ["XDG_CACHE_HOME"] = str(cache)
    jax.config.update("jax_compilation_cache_dir", None)  # the user's, had he named one, would not be cold
    prepare_training()


def say(line: str) -> None:
    """Tell what goes on; standard output is for the result."""
    print(line, file=sys.stderr, flush=True)


def rounded(value: Any) -> Any:
    """The same with floats of five significant digits, which is more than any timing deserves."""
    if isinstance(value, dict):
        return {name: rounded(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(inner) for inner in value]
    if isinstance(value, float):
        return float(f"{value:.5g}") if math.isfinite(value) else None
    return value


if __name__ == "__main__":
    tyro.cli(
        Benchmarks, prog="python -m benchmarks", config=(tyro.conf.FlagCreatePairsOff, tyro.conf.OmitArgPrefixes)
    ).run()
