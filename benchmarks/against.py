"""`python -m benchmarks.against COMMIT`: this state and another, in turn on the same machine, as ratios.

Warns where a rate fell by more than it should. It never fails for that: on a shared machine a rate may fall by itself.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import tyro

from benchmarks.startup import ROOT

RATES = ("env_drone_steps_per_s", "env_drone_steps_per_s_100k_races", "train_steps_per_s")
LARGEST_DROP = 0.15

Figures = Mapping[str, float]


@dataclass(frozen=True)
class Against:
    """Compare the speed of this state with that of another commit."""

    commit: tyro.conf.Positional[str] = "HEAD~1"
    """What to compare with."""
    rounds: int = 2
    """How often each of the two is measured, in turn; a round takes two minutes on two idle cores."""

    def run(self) -> None:
        """Measure both and print the ratios."""
        with _checked_out(self.commit) as before:
            if before is None:
                print(f"speed    not compared: git has no commit {self.commit} here")
                return
            try:
                turns = [_turn(before, ROOT, reverse=bool(turn % 2)) for turn in range(self.rounds)]
            except subprocess.CalledProcessError as failed:
                print(f"speed    not compared: the benchmark of {failed.cmd} failed: {failed.stderr.strip()[-300:]}")
                return
        print("\n".join(verdicts(turns)))


@contextmanager
def _checked_out(commit: str) -> Iterator[Path | None]:
    """A folder with the files of a commit, or None where git does not have it."""
    with tempfile.TemporaryDirectory(prefix="cruise-before-") as folder:
        packed = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=False)
        if packed.returncode != 0:
            yield None
            return
        subprocess.run(["tar", "-x", "-C", folder], input=packed.stdout, check=True)
        yield Path(folder)


def _turn(before: Path, now: Path, reverse: bool) -> tuple[Figures, Figures]:
    """Both once; who comes first changes, because the second finds another machine than the first."""
    order = (now, before) if reverse else (before, now)
    figures = {tree: measure(tree) for tree in order}
    return figures[before], figures[now]


def measure(tree: Path) -> Figures:
    """The headline of the code in a folder, in a process of its own."""
    command = [sys.executable, "-m", "benchmarks", "--quick", "--json"]
    environment = {**os.environ, "PYTHONPATH": str(tree / "src")}
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise subprocess.CalledProcessError(done.returncode, tree.name, done.stdout, done.stderr)
    figures: Figures = json.loads(done.stdout)
    return figures


def verdicts(turns: Sequence[tuple[Figures, Figures]]) -> list[str]:
    """A line per rate: the median over rounds of now over before, and a warning where that is low."""
    lines = []
    for name in RATES:
        ratio = statistics.median(now[name] / before[name] for before, now in turns)
        warning = "" if ratio >= 1 - LARGEST_DROP else f"   WARNING: fell by more than {LARGEST_DROP:.0%}"
        lines.append(f"speed    {name} {ratio:.2f} of what it was{warning}")
    return lines


if __name__ == "__main__":
    tyro.cli(Against).run()
