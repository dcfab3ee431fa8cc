"""The whole table: how the figures change with races, drones, observation and networks."""

import importlib.util
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.environment import EnvironmentCase, round_track, that_fit
from benchmarks.flights import PLANNED_DRONES, PLANNED_SECONDS, EvaluationCase, PlannerCase, pilot_of
from benchmarks.headline import DRONES, RACES, Effort, Say
from benchmarks.machine import PRODUCTS, Case, Copy, CostedCase, Matmul, interleave, platform_kind, rates
from benchmarks.roofline import Ceiling, shares
from benchmarks.startup import race_command, run_command, train_command
from benchmarks.training import TrainingCase
from cruise.config import PPOConfig, TrainConfig

Row = dict[str, Any]
C = TypeVar("C", bound=Case)

RACES_SWEPT = (64, 256, 1024, 4096, 16_384, 65_536, 262_144)
DRONES_SWEPT = (1, 2, 4, 8, 16, 32)
GATES_SWEPT = (4, 8, 16, 32)
DRONES_TRAINED = (1, 2, 3, 4)
NETWORKS = ((32, 32), (64, 64), (128, 128), (256, 256))


def environment_races(effort: Effort, say: Say) -> list[Row]:
    """Drone-steps per second over the number of races, as many as memory lets."""
    rows = [{"races": races} for races in that_fit(RACES_SWEPT)]
    cases = _built(rows, lambda row: EnvironmentCase(row["races"]), "environment", say)
    return _beside_ceilings(rows, cases, "drone_steps_per_s", effort)


def environment_drones(effort: Effort, say: Say) -> list[Row]:
    """Drone-steps per second over the number of drones in a race; about as many drones in the air each time."""
    rows = [{"drones": drones, "races": RACES * DRONES // drones} for drones in DRONES_SWEPT]
    cases = _built(rows, lambda row: EnvironmentCase(row["races"], row["drones"]), "environment", say)
    return _beside_ceilings(rows, cases, "drone_steps_per_s", effort)


def environment_gates(effort: Effort, say: Say) -> list[Row]:
    """Drone-steps per second over the number of gates of a track."""
    rows = [{"gates": gates} for gates in GATES_SWEPT]
    cases = _built(
        rows, lambda row: EnvironmentCase(RACES, DRONES, track=round_track(row["gates"])), "environment", say
    )
    return _beside_ceilings(rows, cases, "drone_steps_per_s", effort)


def environment_observations(effort: Effort, say: Say) -> list[Row]:
    """Drone-steps per second with either observation and with none."""
    rows = [{"observation": kind} for kind in ("extended", "paper", None)]
    cases = _built(rows, lambda row: EnvironmentCase(RACES, DRONES, row["observation"]), "environment", say)
    return _beside_ceilings(rows, cases, "drone_steps_per_s", effort)


def training_drones(effort: Effort, say: Say) -> list[Row]:
    """Training over the number of drones."""
    return _trained([{"drones": drones, "hidden": PPOConfig().hidden} for drones in DRONES_TRAINED], effort, say)


def training_networks(effort: Effort, say: Say) -> list[Row]:
    """Training over the size of the networks."""
    return _trained([{"drones": DRONES, "hidden": hidden} for hidden in NETWORKS], effort, say)


def evaluations(effort: Effort, say: Say) -> list[Row]:
    """Races flown and measured per second, with the shipped policies where there are any."""
    rows = [{"drones": drones, "pilot": pilot_of(drones)} for drones in DRONES_TRAINED]
    cases = _built(rows, lambda row: EvaluationCase(row["drones"]), "evaluation", say)
    return _beside_ceilings(rows, cases, "races_per_s", effort)


def planner(effort: Effort, say: Say) -> list[Row]:
    """How long SE-IBR takes to plan for all drones of many races, every 0.1 s in three rounds, and plans per second."""
    rows: list[Row] = [{"drones": PLANNED_DRONES, "seconds_flown": PLANNED_SECONDS}]
    (case,) = cases = _built(rows, lambda row: PlannerCase(), "the planner", say)
    (row,) = _beside_ceilings(rows, cases, "plans_per_s", effort._replace(rounds=3))
    return [{"races": case.races, **row, "seconds": case.work / row["plans_per_s"]}]


def interfaces(effort: Effort, say: Say) -> list[Row]:
    """Drone-steps per second through Gymnasium and PettingZoo, one race and many; no row where they are missing."""
    if any(importlib.util.find_spec(library) is None for library in ("gymnasium", "pettingzoo")):
        say("left out, because gymnasium or pettingzoo is not installed: their interfaces")
        return []
    from benchmarks.adapters import DRONES as EACH  # noqa: PLC0415
    from benchmarks.adapters import INTERFACES, InterfaceCase  # noqa: PLC0415

    rows: list[Row] = [{"interface": name} for name in INTERFACES]
    cases = _built(rows, lambda row: InterfaceCase(row["interface"]), "interface", say)
    rows = [row | {"races": case.races, "drones": EACH} for row, case in zip(rows, cases, strict=True)]
    return _timed(rows, cases, "drone_steps_per_s", effort)


def commands(say: Say) -> list[Row]:
    """Whole commands in processes of their own: how long they take, cold and warm, and the memory they need."""
    rows: list[Row] = []
    for name in ("race", "train"):
        say(f"cruise {name}, cold, then warm")
        with tempfile.TemporaryDirectory() as cache:
            rows += [_run_one(name, Path(cache), filled) for filled in (False, True)]
    return rows


def _run_one(name: str, cache: Path, filled: bool) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder)
        arguments = race_command(where, pilot_of(DRONES)) if name == "race" else train_command(where)
        took = run_command(cache, *arguments)
    return {"command": f"cruise {name}", "cache": "filled" if filled else "empty", **took._asdict()}


def sweep(effort: Effort, say: Say) -> dict[str, list[Row]]:
    """Every table, by name."""
    of_environment = (environment_races, environment_drones, environment_gates, environment_observations)
    tables = (*of_environment, training_drones, training_networks, evaluations, planner, interfaces)
    swept = {table.__name__: table(effort, say) for table in tables}
    return {**swept, "commands": commands(say)}


def _built(rows: list[Row], build: Callable[[Row], C], what: str, say: Say) -> list[C]:
    cases = []
    for row in rows:
        say(f"compiling {what}: {', '.join(f'{name} {value}' for name, value in row.items())}")
        cases.append(build(row))
    say(f"timing {what}")
    return cases


def _timed(rows: list[Row], cases: Sequence[Case], unit: str, effort: Effort) -> list[Row]:
    """The rows with the rate of each case, all cases in turn."""
    named: Mapping[str, Case] = {str(place): case for place, case in enumerate(cases)}
    taken = interleave(named, effort.rounds, effort.seconds)
    per_second = rates(named, taken)
    return [row | {unit: per_second[name], "rounds": len(taken[name])} for name, row in zip(named, rows, strict=True)]


def _beside_ceilings(rows: list[Row], cases: Sequence[CostedCase], unit: str, effort: Effort) -> list[Row]:
    """The same, with what a unit costs and how near its rate comes to what this machine can do in the same rounds."""
    ceilings = Matmul(PRODUCTS[platform_kind()][-1]), Copy()
    *timed, product, copy = _timed([*rows, {}, {}], [*cases, *ceilings], unit, effort)
    ceiling = Ceiling(product[unit], copy[unit])
    return [row | shares(case.cost, row[unit], ceiling) for row, case in zip(timed, cases, strict=True)]


def _trained(rows: list[Row], effort: Effort, say: Say) -> list[Row]:
    def build(row: Row) -> TrainingCase:
        return TrainingCase(TrainConfig(drones=row["drones"], ppo=PPOConfig(hidden=row["hidden"])))

    return _beside_ceilings(rows, _built(rows, build, "training", say), "steps_per_s", effort)
