"""`python -m benchmarks.skill`: from an empty cache to the skill of the paper's two drones on the ring."""

import json
import math
import statistics
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console
from rich.table import Table

import cruise
from benchmarks.machine import describe_machine, versions
from benchmarks.startup import run_command

TRACK, DRONES = "ring", 2
SUCCESS, SPEED = 0.95, 4.4  # the least share of drones that finish, the least mean speed [m/s]
EVALUATION_SEED = 2026
RECIPE = f"--track {TRACK} --drones {DRONES} --vanilla"  # the last stage and self-play from the start


@dataclass(frozen=True)
class Skill:
    """How long `cruise train` takes to the paper's skill on this machine, once per seed, each from a cold start."""

    seeds: int = 5
    """Trainings, one after the other."""
    step_scale: float = 0.5
    """Share of the 40 million steps that each may take."""
    episodes: int = 100
    """Races in which each policy is measured; their time does not count."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def run(self) -> None:
        """Train, measure, tell the median."""
        rows = [self._train(seed) for seed in range(self.seeds)]
        told = {"median_s": median_to_skill(rows), "seeds": rows, "machine": describe_machine(), "versions": versions()}
        if self.json:
            print(json.dumps(told, indent=2))
        else:
            Console().print(table(rows))

    def _train(self, seed: int) -> dict[str, Any]:
        with tempfile.TemporaryDirectory(prefix="cruise-skill-") as folder:
            run = Path(folder) / "run"
            flags = f"{RECIPE} --seed {seed} --step-scale {self.step_scale} --episodes 1"
            took = run_command(Path(folder), "train", *flags.split(), "--out", str(run))
            found = cruise.evaluate(TRACK, DRONES, [run], episodes=self.episodes, seed=EVALUATION_SEED).to_dict()
        success, speed = found["success_rate"]["mean"], found["mean_speed"]["mean"]
        reached = success >= SUCCESS and speed is not None and speed >= SPEED  # None: no drone finished
        row = {"seed": seed, "seconds": took.total_s, "success": success, "speed": speed, "reached": reached}
        print(" ".join(f"{name} {value}" for name, value in row.items()), file=sys.stderr, flush=True)
        return row


def median_to_skill(rows: list[dict[str, Any]]) -> float | None:
    """Median time to the skill [s], a training that did not get there counted as endless; None where most did not."""
    median = statistics.median(row["seconds"] if row["reached"] else math.inf for row in rows)
    return median if math.isfinite(median) else None


def table(rows: list[dict[str, Any]]) -> Table:
    """A row per training, the median in the caption."""
    median = median_to_skill(rows)
    told = "not reached by most" if median is None else f"median {median:.0f} s"
    shown = Table(
        title=f"{TRACK}, {DRONES} drones: at least {SUCCESS:.0%} of drones finish, at {SPEED} m/s", caption=told
    )
    for heading in ("seed", "training, s", "success, %", "mean speed, m/s", "reached"):
        shown.add_column(heading, justify="right")
    for row in rows:
        speed = "-" if row["speed"] is None else f"{row['speed']:.3f}"
        values = (f"{row['seconds']:.0f}", f"{100 * row['success']:.1f}", speed)
        shown.add_row(str(row["seed"]), *values, "yes" if row["reached"] else "no")
    return shown


if __name__ == "__main__":
    tyro.cli(Skill).run()
