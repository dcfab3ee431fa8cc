"""What to type to make a result again."""

import dataclasses
import shlex
from typing import Any

from cruise.config import RewardWeights, TrainConfig
from cruise.presets import REWARDS, training_config
from experiments.plan import Job, Scale


def reproduce_command(job: Job, scale: Scale) -> str:
    """Makes one job's result."""
    quick = " --quick" if scale.name == "quick" else ""
    seeds = f" --seeds {job.seed + 1}" if job.seed > 2 else ""
    return f"cruise reproduce{quick}{seeds} --only {job.kind} {job.track} {job.drones} s{job.seed}"


def train_command(config: TrainConfig) -> str:
    """Trains with this configuration: the flags that differ from the defaults."""
    flags = [f"--track {shlex.quote(config.track)} --drones {config.drones} --seed {config.seed}"]
    flags += _flags(config, training_config(drones=config.drones), skip=("track", "drones", "seed", "reward"))
    preset = next((name for name, reward in REWARDS.items() if reward == config.reward), None)
    if preset is None:
        flags += _flags(config.reward, RewardWeights())
    elif preset != "default":
        flags.append(f"--reward-preset {preset}")
    return " ".join(["cruise train", *flags])


def _flags(config: Any, default: Any, skip: tuple[str, ...] = ()) -> list[str]:
    flags: list[str] = []
    for field in dataclasses.fields(config):
        value, usual = getattr(config, field.name), getattr(default, field.name)
        if value == usual or field.name in skip:
            continue
        name = field.name.replace("_", "-")
        if dataclasses.is_dataclass(value):
            flags += _flags(value, usual)
        elif isinstance(value, bool):
            flags.append(f"--{name}" if value else f"--no-{name}")
        else:
            values = value if isinstance(value, tuple) else (value,)
            flags.append(f"--{name} {' '.join(shlex.quote(str(v)) for v in values)}")
    return flags
