"""The benchmarks count and report correctly. How fast anything is, no test says."""

import contextlib
import io
import json
import math
import subprocess
from dataclasses import replace
from pathlib import Path

import jax
import jax.extend.core
import numpy as np
import pytest
from rich.console import Console

from benchmarks import against, environment, headline
from benchmarks.__main__ import rounded
from benchmarks.adapters import INTERFACES, InterfaceCase
from benchmarks.against import RATES, Against, verdicts
from benchmarks.doors import FunctionalCase, processor_seconds
from benchmarks.environment import EnvironmentCase, round_track, that_fit
from benchmarks.machine import LEAST_ROUNDS, interleave, peak_memory_mb, rates
from benchmarks.report import show
from benchmarks.roofline import Cost
from benchmarks.skill import Skill, median_to_skill
from benchmarks.skill import table as skill_table
from benchmarks.startup import Start, run_command
from benchmarks.sweeps import GATES_SWEPT
from benchmarks.training import train_flop, trainer_flop
from cruise.config import PPOConfig
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.track_file import track_faults
from cruise.training.trainer import Trainer
from cruise.training.types import ACTIVE
from tests.training.runs import TINY

KEYS = {
    "env_drone_steps_per_s",
    "env_drone_steps_per_s_100k_races",
    "train_steps_per_s",
    "train_roofline_share",
    "train_copy_share",
    "matmul_gflops",
    "copy_gb_per_s",
    "env_flop_share",
    "env_copy_share",
    "flop_per_train_step",
    "compile_s",
    "warm_start_s",
    "peak_memory_mb",
    "machine",
    "versions",
    "cores",
}


def test_flop_formula_against_a_count_by_hand():
    ppo = PPOConfig(rollout_steps=2, epochs=2, hidden=(4, 3))
    flop = train_flop(observation_size=5, action_size=2, drones=3, ppo=ppo)
    actor, critic = 2 * (5 * 4 + 4 * 3 + 3 * 2), 2 * (5 * 4 + 4 * 3 + 3 * 1)  # 76, 70
    assert flop.acting == actor + critic + critic / 2
    assert flop.opponents == 2 * actor
    # Per epoch: forward, gradients of all weights, gradients of the inputs of the second and third layer.
    inputs = 2 * (4 * 3 + 3 * 2) + 2 * (4 * 3 + 3 * 1)
    assert flop.learning == 2 * (2 * (actor + critic) + inputs)
    assert flop.total == 181 + 152 + 716
    assert train_flop(5, 2, 1, ppo).opponents == 0


def products(jaxpr: jax.extend.core.Jaxpr) -> int:
    """Operations of every matrix product in a program, loops unrolled, the cheapest branch taken, norms left out."""
    total = 0
    for equation in jaxpr.eqns:
        inner = [products(sub) for sub in jax.extend.core.jaxprs_in_params(equation.params)]
        if equation.primitive.name == "dot_general" and equation.invars[0].aval.ndim > 1:
            (contracted, _), _ = equation.params["dimension_numbers"]
            length = math.prod(equation.invars[0].aval.shape[axis] for axis in contracted)
            total += 2 * length * math.prod(equation.outvars[0].aval.shape)
        elif equation.primitive.name == "cond":
            total += min(inner)
        else:
            total += equation.params.get("length", 1) * sum(inner)
    return total


@pytest.mark.parametrize("gates", GATES_SWEPT)
def test_a_round_track_of_any_length_can_be_flown(gates):
    track = round_track(gates)
    assert len(track.gates) == gates
    assert track_faults(track) == []


def test_flop_counted_against_the_program():
    trainer = Trainer(replace(TINY, drones=3), TRACKS["ring"], VEHICLES["paper"])
    rules = trainer.rules_of(trainer.phases[-1])
    program = jax.make_jaxpr(trainer.update)(trainer.state_shape(), rules, np.bool_(False))
    assert products(program.jaxpr) == trainer_flop(trainer).total * trainer.steps_per_update


def test_races_of_the_environment_benchmark_begin_again_from_the_pool():
    case = EnvironmentCase(races=16, drones=1)
    assert case.work == 16 * case.steps
    case()
    races = case.carried
    age = np.asarray(races.state.step)
    assert np.isfinite(races.reward).all()
    assert np.isfinite(races.observation).all()
    assert (age >= 1).all()
    assert (age <= case.steps).all()
    np.testing.assert_array_equal(races.state.out[:, ACTIVE], races.restart)  # who is out does not fly on
    assert races.restarts.sum() >= (age < case.steps).sum()
    case()
    assert (np.asarray(case.carried.state.step) <= 2 * case.steps).all()


@pytest.mark.parametrize(("races", "size"), [(1, 1), (16, 16), (2048, 256), (50_000, 250), (257, 1)])
def test_blocks_share_the_races(races, size):
    assert environment.block_size(races) == size
    assert environment.block_size(races, "gpu") == races


def test_as_many_races_as_memory_lets(monkeypatch):
    needed = environment.memory_needed_mb(64, 2)
    monkeypatch.setattr(environment, "available_memory_mb", lambda: 2 * 5.5 * needed)
    assert environment.memory_needed_mb(256, 2) == pytest.approx(4 * needed)
    assert that_fit((256, 64, 1024), drones=2) == (64, 256)


@pytest.mark.parametrize("interface", INTERFACES)
def test_interfaces_are_stepped_as_often_as_is_said(interface):
    """Every step of every drone is in the unit; the races go on from call to call."""
    case = InterfaceCase(interface, races=3, drones=2, steps=4)
    assert case.work == (3 if interface.endswith("vector") else 1) * 2 * 4
    before = np.asarray(case.env._races.state.step).copy()
    case()
    np.testing.assert_array_equal(np.asarray(case.env._races.state.step), before + 4)


def test_a_rollout_of_races_under_vmap_flies_on():
    case = FunctionalCase("agents", races=2, drones=1, length=3)
    assert case.work == 2 * 3
    for before in (0, 3):
        np.testing.assert_array_equal(case._state.state.step, before)
        assert processor_seconds(case) > 0


class Counted:
    """A case that does nothing and remembers when."""

    work = 3.0
    cost = Cost(flop=10.0, bytes=20.0)

    def __init__(self, calls, name):
        self.calls, self.name = calls, name

    def __call__(self):
        self.calls.append(self.name)


def test_cases_take_turns():
    calls = []
    cases = {name: Counted(calls, name) for name in "ab"}
    taken = interleave(cases, rounds=5, seconds=60.0)
    assert "".join(calls) == "ab" * 6  # a first round that is not counted
    assert {name: len(times) for name, times in taken.items()} == {"a": 5, "b": 5}
    assert rates(cases, {"a": [1.0, 3.0, 2.0], "b": [1.0]}) == {"a": 1.5, "b": 3.0}
    assert len(interleave(cases, rounds=5, seconds=0.0)["a"]) == LEAST_ROUNDS


def test_headline_has_every_key(monkeypatch, tmp_path):
    monkeypatch.setattr(headline, "start_training", lambda cache: Start(9.0, 8.0, 700.0))
    monkeypatch.setattr(headline, "EnvironmentCase", lambda races, drones: Counted([], "environment"))
    sizes = headline.Sizes(TINY, few=8, many=8, products=(8, 16), copied=1024)
    figures = headline.headline(headline.Effort(3, 0.0, 2), tmp_path, lambda line: None, sizes)
    assert figures.keys() >= KEYS
    assert figures["train_roofline_share"] == pytest.approx(
        figures["train_steps_per_s"] * figures["flop_per_train_step"] / (figures["matmul_gflops"] * 1e9)
    )
    assert figures["env_copy_share"] == pytest.approx(
        figures["env_drone_steps_per_s"] * 20 / (figures["copy_gb_per_s"] * 1e9)
    )
    assert (figures["compile_s"], figures["warm_start_s"], figures["peak_memory_mb"]) == (8.0, 9.0, 700.0)
    assert json.loads(json.dumps(rounded(figures), allow_nan=False)).keys() == figures.keys()

    tables = {"evaluations": [{"drones": 2, "pilot": "chaser", "races_per_s": 12345.678, "hidden": (64, 64)}]}
    out = io.StringIO()
    show(figures | {"tables": tables}, Console(file=out, width=120))
    assert "12,346" in out.getvalue()
    assert "64-64" in out.getvalue()


def test_rounded_keeps_what_json_can_say():
    assert rounded({"a": [1.23456789, float("nan")], "b": (1, "x", None)}) == {"a": [1.2346, None], "b": [1, "x", None]}


def test_a_command_in_a_process_of_its_own(tmp_path: Path):
    run = run_command(tmp_path, "tracks", "list")
    assert run.total_s > 0
    assert 10 < run.peak_memory_mb < 2000
    assert peak_memory_mb() > 10
    with pytest.raises(RuntimeError, match="unknown command"):
        run_command(tmp_path, "walk")


def test_a_slower_state_is_warned_of():
    before = dict.fromkeys(RATES, 10.0)
    turns = [(before, before | {"train_steps_per_s": rate}) for rate in (8.0, 8.2, 20.0)]
    lines = verdicts(turns)
    assert [line.split()[2] for line in lines] == ["1.00", "1.00", "0.82"]
    assert ["WARNING: fell by more than 15%" in line for line in lines] == [False, False, True]
    assert not any("WARNING" in line for line in verdicts([(before, dict.fromkeys(RATES, 8.6))]))


def test_where_there_is_nothing_to_compare_with_nothing_fails(capsys, monkeypatch):
    Against("0123abc").run()
    assert capsys.readouterr().out == "speed    not compared: git has no commit 0123abc here\n"

    def fails(tree):
        raise subprocess.CalledProcessError(1, tree.name, "", "no such module")

    monkeypatch.setattr(against, "measure", fails)
    monkeypatch.setattr(against, "_checked_out", lambda commit: contextlib.nullcontext(against.ROOT))
    Against("HEAD").run()
    assert "failed: no such module" in capsys.readouterr().out


def test_time_to_skill_is_measured_by_training(capsys):
    Skill(seeds=1, step_scale=0.0005, episodes=1, json=True).run()
    told = json.loads(capsys.readouterr().out)
    (row,) = told["seeds"]
    assert row["seconds"] > 1
    assert (row["success"], row["reached"], told["median_s"]) == (0.0, False, None)


def test_a_training_that_never_got_there_counts_as_endless():
    rows = [{"seed": k, "seconds": 10.0 * k, "success": 1.0, "speed": 4.5, "reached": k != 1} for k in (1, 2, 3)]
    rows[0]["speed"] = None
    assert median_to_skill(rows) == 30.0
    assert skill_table(rows).caption == "median 30 s"
    assert median_to_skill([row | {"reached": False} for row in rows]) is None
