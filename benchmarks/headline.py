"""The figures that matter most, quick enough to be taken after every change."""

import statistics
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.environment import EnvironmentCase
from benchmarks.machine import MATMUL_SIZES, Case, Matmul, cores, describe_machine, interleave, rates, versions
from benchmarks.startup import Start, start_training
from benchmarks.training import TrainingCase, environment_flop, trainer_flop
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
    products: tuple[int, ...]  # side of the matrices


SIZES = Sizes(TrainConfig(drones=DRONES), RACES, MANY_RACES, MATMUL_SIZES)


class Subjects(NamedTuple):
    """What is timed, compiled."""

    training: TrainingCase
    few: EnvironmentCase
    many: EnvironmentCase
    products: dict[str, Matmul]


def measure_rates(subjects: Subjects, effort: Effort) -> dict[str, Any]:
    """Training, environment and matrix products in turn, then the environment with few and with many races."""
    training, few, many, products = subjects
    together: dict[str, Case] = {"training": training, "environment": few, **products}
    taken = interleave(together, effort.rounds, effort.seconds)
    apart: dict[str, Case] = {"few": few, "many": many}
    taken_apart = interleave(apart, effort.rounds // 3, effort.seconds)
    per_second, per_second_apart = rates(together, taken), rates(apart, taken_apart)
    return {
        "env_drone_steps_per_s": per_second["environment"],
        "env_drone_steps_per_s_100k_races": per_second_apart["many"],
        "env_share_100k_races": per_second_apart["many"] / per_second_apart["few"],
        **roofline(training, per_second["training"], max(per_second[name] for name in products)),
        "rounds": {"training, environment, matmul": len(taken["training"]), "100k races": len(taken_apart["many"])},
    }


def roofline(training: TrainingCase, steps_per_s: float, flop_per_s: float) -> dict[str, Any]:
    """Steps per second against those that the machine could make if all its time went into matrix products."""
    flop = trainer_flop(training.trainer)
    return {
        "train_steps_per_s": steps_per_s,
        "train_roofline_share": steps_per_s * flop.total / flop_per_s,
        "matmul_gflops": flop_per_s / 1e9,
        "flop_per_train_step": flop.total,
        "flop_per_train_step_by_part": flop._asdict(),
        "env_flop_per_train_step": environment_flop(training.trainer.env, training.rules),
    }


def headline(effort: Effort, cache: Path, say: Say, sizes: Sizes = SIZES) -> dict[str, Any]:
    """One object with every figure and what is needed to read it."""
    about = {"machine": describe_machine(), "versions": versions(), "cores": cores()}
    starts = measure_starts(effort, cache, say)
    say("compiling training and the environment")
    with ThreadPoolExecutor() as beside:
        few, many = (beside.submit(EnvironmentCase, races, sizes.config.drones) for races in (sizes.few, sizes.many))
        training = TrainingCase(sizes.config)
        products = {f"matmul {size}": Matmul(size) for size in sizes.products}
        subjects = Subjects(training, few.result(), many.result(), products)
    say("timing training, the environment and matrix products")
    return {**measure_rates(subjects, effort), **starts, "method": METHOD, **about}


METHOD = {
    "statistic": "median over interleaved rounds, the first round not counted; starts: median over fresh processes",
    "environment": f"ring, {DRONES} drones, {RACES} and {MANY_RACES} races, uniform random actions sliced at a varying "
    "offset from a block drawn beforehand, extended observation, reward, auto-reset from a pool of starts",
    "training": f"Trainer.update, ring, {DRONES} drones, last stage, default PPO",
    "flop_per_train_step": "products of the networks only, two operations per weight, nothing counted twice",
    "peak_memory_mb": "the highest of the processes that start, compile and train",
}
