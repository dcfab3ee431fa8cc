"""`python -m benchmarks.peers`: rates side by side, every case in turn, and how many times faster CRUISE is."""

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import tyro
from rich.console import Console
from rich.table import Table

from benchmarks.environment import EnvironmentCase
from benchmarks.headline import DRONES, RACES
from benchmarks.machine import Case, describe_machine, interleave, rates, versions
from benchmarks.peers.apart import Apart
from benchmarks.peers.cases import (
    PlainEnvironment,
    sbx_on_ours,
    stable_baselines_as_the_paper,
    stable_baselines_on_ours,
)
from benchmarks.peers.simulators import Rotorpy
from benchmarks.training import TrainingCase
from benchmarks.vehicles import PhysicsCase
from cruise.cli.compilation import prepare_training
from cruise.config import TrainConfig
from cruise.presets import VEHICLES

OURS = "CRUISE"
CRAZYFLOW_PYTHON = ".venv-crazyflow/bin/python"  # `make peers` makes it: Crazyflow excludes our version of JAX
ENVIRONMENT: Mapping[str, Callable[[], Case]] = {
    OURS: lambda: EnvironmentCase(RACES, DRONES),
    "plain NumPy, one race": PlainEnvironment,
}
TRAINING: Mapping[str, Callable[[], Case]] = {
    OURS: lambda: TrainingCase(TrainConfig(drones=DRONES)),
    "Stable-Baselines3, as the paper trained": stable_baselines_as_the_paper,
    "Stable-Baselines3 on CRUISE's races": stable_baselines_on_ours,
    "Stable-Baselines3's defaults on CRUISE's races": lambda: stable_baselines_on_ours(n_steps=64),
    "SBX on CRUISE's races": sbx_on_ours,
    "Brax's PPO on CRUISE's races": lambda: Apart(sys.executable, "benchmarks.peers.brax_race:BraxPPO"),
}
SIMULATORS: Mapping[str, Callable[[], Case]] = {
    OURS: lambda: EnvironmentCase(RACES, DRONES, "body", "racer"),
    "CRUISE, physics alone": lambda: PhysicsCase(VEHICLES["racer"]),
    "Crazyflow, 50 Hz over 500 Hz": lambda: Apart(CRAZYFLOW_PYTHON, "benchmarks.peers.simulators:crazyflow"),
    "Crazyflow, its own 500 Hz": lambda: Apart(CRAZYFLOW_PYTHON, "benchmarks.peers.simulators:crazyflow_own"),
    "RotorPy, batched, 50 Hz": Rotorpy,
}
GROUPS: Mapping[str, Mapping[str, Callable[[], Case]]] = {
    "environment_drone_steps_per_s": ENVIRONMENT,
    "training_steps_per_s": TRAINING,
    "thrust_and_rates_drone_steps_per_s": SIMULATORS,
}


@dataclass(frozen=True)
class Peers:
    """How fast CRUISE and others are at the same work, on this machine, in turn."""

    rounds: int = 5
    """How often each is timed, after a first time that does not count."""
    json: bool = False
    """Print one JSON object instead of tables."""

    def run(self) -> None:
        """Time whatever is installed; name what is not."""
        prepare_training()
        found = {name: compare(kinds, self.rounds) for name, kinds in GROUPS.items()}
        if self.json:
            told = {"machine": describe_machine(), "versions": versions(), **found}
            print(json.dumps(told, indent=2))
            return
        for title, rows in found.items():
            Console().print(table(title.replace("_", " "), rows))


def compare(kinds: Mapping[str, Callable[[], Case]], rounds: int) -> list[dict[str, Any]]:
    """A row per case: its rate, and how many times faster ours is; no rate where its library is missing."""
    cases: dict[str, Case] = {}
    for name, build in kinds.items():
        try:
            cases[name] = build()
        except ImportError as missing:
            print(f"left out: {name} ({missing.name} is not installed)")
    per_second = rates(cases, interleave(cases, rounds, float("inf")))
    return [
        {"who": name, "per_s": rate, "ours_is_faster": per_second[OURS] / rate} for name, rate in per_second.items()
    ]


def table(title: str, rows: list[dict[str, Any]]) -> Table:
    """A line per case."""
    shown = Table("", "per second", "CRUISE is faster", title=title)
    for row in rows:
        shown.add_row(row["who"], f"{row['per_s']:,.0f}", f"{row['ours_is_faster']:,.1f} times")
    return shown


if __name__ == "__main__":
    tyro.cli(Peers).run()
