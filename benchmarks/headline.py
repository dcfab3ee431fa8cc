"""The figures that matter most, quick enough to be taken after every change."""

import statistics
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.environment import EnvironmentCase
from benchmarks.machine import (
    PRODUCTS,
    Case,
    Copy,
    Matmul,
    cores,
    describe_machine,
    interleave,
    platform_kind,
    rates,
    versions,
)
from benchmarks.roofline import Ceiling, shares
from benchmarks.startup import Start, start_training
from benchmarks.training import TrainingCase
from cruise.config import TrainConfig

DRONES = 4
RACES, MANY_RACES = 4096, 100_000

Say = Callable[[str], None]


class Effort(NamedTuple):
    """How long a benchmark may look."""

    rounds: int
    seconds: float  # per group of cases, compiling apart
    starts: int  # processes started cold, and as many warm


QUICK = Effort(rounds=10, seconds=3.0, starts=1)
FULL = Effort(rounds=15, seconds=30.0, starts=3)


def measure_starts(effort: Effort, cache: Path, say: Say) -> dict[str, Any]:
    """Training started cold and warm, each in a fresh process. Leaves what was compiled in `cache`."""
    cold: list[Start] = []
    warm: list[Start] = []
    for number in range(effort.starts):
        say(f"starting training cold, then warm ({number + 1} of {effort.starts})")
        with tempfile.TemporaryDirectory() as folder:
            last = number == effort.starts - 1
            here = cache if last else Path(folder)
            cold.append(start_training(here))
            warm.append(start_training(here))
    return {
        "compile_s": statistics.median(start.compile_s for start in cold),
        "cold_start_s": statistics.median(start.total_s for start in cold),
        "warm_start_s": statistics.median(start.total_s for start in warm),
        "peak_memory_mb": max(start.peak_memory_mb for start in cold + warm),
    }


class Sizes(NamedTuple):
    """Of what is timed."""

    config: TrainConfig
    few: int  # races
    many: int
    products: tuple[int, ...] | None = None  # sides of the matrices; None: what the device needs
    copied: int | None = None  # bytes; the same


SIZES = Sizes(TrainConfig(drones=DRONES), RACES, MANY_RACES)


class Subjects(NamedTuple):
    """What is timed, compiled."""

    training: TrainingCase
    few: EnvironmentCase
    many: EnvironmentCase
    products: dict[str, Matmul]
    copy: Copy


def measure_rates(subjects: Subjects, effort: Effort) -> dict[str, Any]:
    """Training, environment and both ceilings in turn, then the environment with few and with many races."""
    training, few, many, products, copy = subjects
    together: dict[str, Case] = {"training": training, "environment": few, **products, "copy": copy}
    taken = interleave(together, effort.rounds, effort.seconds)
    apart: dict[str, Case] = {"few": few, "many": many}
    taken_apart = interleave(apart, effort.rounds // 3, effort.seconds)
    per_second, per_second_apart = rates(together, taken), rates(apart, taken_apart)
    return {
        "env_drone_steps_per_s": per_second["environment"],
        "env_drone_steps_per_s_100k_races": per_second_apart["many"],
        "env_share_100k_races": per_second_apart["many"] / per_second_apart["few"],
        "train_steps_per_s": per_second["training"],
        **rooflines(subjects, per_second, Ceiling(max(per_second[name] for name in products), per_second["copy"])),
        "rounds": {"training, environment, ceilings": len(taken["training"]), "100k races": len(taken_apart["many"])},
    }


def rooflines(subjects: Subjects, per_second: dict[str, float], ceiling: Ceiling) -> dict[str, Any]:
    """What a step costs, and how near its rate comes to what the machine could do if it did nothing else."""
    training = shares(subjects.training.cost, per_second["training"], ceiling)
    environment = shares(subjects.few.cost, per_second["environment"], ceiling)
    return {
        "matmul_gflops": ceiling.flop_per_s / 1e9,
        "copy_gb_per_s": ceiling.bytes_per_s / 1e9,
        "train_roofline_share": training["flop_share"],
        "train_copy_share": training["copy_share"],
        "flop_per_train_step": training["flop"],
        "flop_per_train_step_by_part": subjects.training.flop._asdict(),
        "bytes_per_train_step": training["bytes"],
        "env_flop_share": environment["flop_share"],
        "env_copy_share": environment["copy_share"],
        "flop_per_env_drone_step": environment["flop"],
        "bytes_per_env_drone_step": environment["bytes"],
    }


def headline(effort: Effort, cache: Path, say: Say, sizes: Sizes = SIZES) -> dict[str, Any]:
    """One object with every figure and what is needed to read it."""
    about = {"machine": describe_machine(), "versions": versions(), "cores": cores()}
    starts = measure_starts(effort, cache, say)
    say("compiling training and the environment")
    with ThreadPoolExecutor() as beside:
        few, many = (beside.submit(EnvironmentCase, races, sizes.config.drones) for races in (sizes.few, sizes.many))
        training = TrainingCase(sizes.config)
        products = {f"matmul {size}": Matmul(size) for size in sizes.products or PRODUCTS[platform_kind()]}
        subjects = Subjects(training, few.result(), many.result(), products, Copy(sizes.copied))
    say("timing training, the environment, matrix products and copying")
    return {**measure_rates(subjects, effort), **starts, "method": METHOD, **about}


METHOD = {
    "statistic": "median over interleaved rounds, the first round not counted; starts: median over fresh processes",
    "environment": f"ring, {DRONES} drones, {RACES} and {MANY_RACES} races, uniform random actions sliced at a varying "
    "offset from a block drawn beforehand, extended observation, reward, auto-reset from a pool of starts",
    "training": f"Trainer.update, ring, {DRONES} drones, last stage, default PPO",
    "flop_per_train_step": "products of the networks only, two operations per weight, nothing counted twice",
    "flop_per_env_drone_step": "floating-point operations of the program as written",
    "bytes_per_train_step, bytes_per_env_drone_step": "what loops carry, take and leave, operands and results of "
    "products, what is read by index",
    "peak_memory_mb": "the highest of the processes that start, compile and train",
}
