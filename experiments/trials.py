"""Single trainings with other settings than the study's, which show what was tried: descriptions of their policies."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cruise.config import TrainConfig
from cruise.errors import CruiseError
from cruise.storage.config_file import from_data
from cruise.storage.policy_file import PolicyMeta, read_meta
from experiments.commands import train_command
from experiments.table import Entry, Number, Table

TRIALS = "trials"  # folder below `results`
COLUMNS = (("success_rate", 100, 1), ("mean_speed", 1, 2), ("flying_lap_time", 1, 2))  # name, factor, digits


def read_trials(folder: Path) -> tuple[PolicyMeta, ...]:
    """What `policy.json` says of every trial. Raises CruiseError where one is not sound."""
    return tuple(read_meta(path) for path in sorted((folder / TRIALS).glob("*.json")))


def trial_table(trials: Sequence[PolicyMeta]) -> Table:
    """One row per trial, alike ones together."""
    rows = sorted((_row(trial) for trial in trials), key=lambda row: row[0])
    return Table(
        "trials",
        "What was tried for speed and for success: single trainings",
        ("drones", "what makes it", "success [%]", "mean speed [m/s]", "timed lap [s]"),
        tuple(row for _, row in rows),
    )


def _row(trial: PolicyMeta) -> tuple[tuple[Any, ...], tuple[Entry, ...]]:
    """By what rows are sorted, and the row."""
    config = from_data(trial.config, TrainConfig, f"trial {trial.name}")
    try:
        found = [(trial.results[name]["mean"], factor, digits) for name, factor, digits in COLUMNS]
    except (KeyError, TypeError):
        raise CruiseError(f"trial {trial.name}: results lack success_rate, mean_speed or flying_lap_time") from None
    numbers = (Number(math.nan if mean is None else factor * mean, digits=digits) for mean, factor, digits in found)
    alike = train_command(replace(config, seed=0))
    return (config.drones, alike, config.seed), (str(config.drones), train_command(config), *numbers)
