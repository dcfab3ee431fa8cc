"""The examples fly."""

import contextlib
import importlib
import io
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from cruise.evaluation.matches import make_match, run_races
from cruise.evaluation.metrics import race_result
from cruise.evaluation.pilot_choice import find_pilot
from cruise.export.contract import export_env, make_contract
from cruise.export.onnx_policy import onnx_model
from cruise.export.pilot_program import make_model
from cruise.presets import TRACKS
from cruise.storage.policy_file import read_policy
from tests.storage.policies import write_policy

EXAMPLES = Path(__file__).parent.parent / "examples"


def test_the_pid_pilot_flies_among_others():
    match = make_match(TRACKS["figure-eight"], 3, f"{EXAMPLES}/pid_pilot.py:Pilot", laps=1)
    results = [race_result(log) for log in run_races(match, 4, seed=1)]
    assert match.team[0].name == "PID"
    assert all(drone.finished and drone.missed_gates == 0 for result in results for drone in result.drones)


class Seen:
    """As much of a view as a network sees."""

    def __init__(self, observation):
        self.observation = observation


def test_a_network_of_ones_own_in_onnx(tmp_path, monkeypatch):
    policy = read_policy(write_policy(tmp_path / "duel"))
    env = export_env(policy, TRACKS["ring"])
    model = make_model(policy, env, "observation")
    contract = make_contract(policy, TRACKS["ring"], env, "observation", model)
    (tmp_path / "policy.onnx").write_bytes(onnx_model(model, contract))
    monkeypatch.setenv("PILOT_MODEL", str(tmp_path / "policy.onnx"))
    pilot = find_pilot(f"{EXAMPLES}/onnx_pilot.py:Pilot")
    assert (pilot.style, pilot.observation, pilot.name) == ("batch", "extended", "ONNX network")
    seen = np.random.default_rng(0).normal(size=(6, 38)).astype(np.float32)
    wanted = np.asarray(policy.params.mean_action(jnp.asarray(seen.T))).T
    np.testing.assert_allclose(pilot.make()(Seen(seen)), wanted, atol=1e-5)


def test_the_loop_in_jax_learns_from_every_drone(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    loop = importlib.import_module("train_jax")
    for name, value in {"RACES": 8, "STEPS": 8, "EPOCHS": 1, "MINIBATCHES": 2}.items():
        monkeypatch.setattr(loop, name, value)
    lines = []
    params, speed, crashes = loop.train(2 * 8 * 8 * 2, show=lines.append, track="ring", drones=2)
    assert lines[-1].startswith("        256 steps, ")
    assert 0.0 <= crashes <= 1.0
    assert 0.0 < speed < 20.0
    assert all(jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(params))
    assert (params["log_std"] != -0.5).all()


def test_the_notebook_runs_from_top_to_bottom():
    cells = json.loads((EXAMPLES / "first_race.ipynb").read_text())["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    names, said = {}, io.StringIO()
    with contextlib.redirect_stdout(said):
        for number, cell in enumerate(code):
            exec(compile(cell, f"cell {number}", "exec"), names)
    assert names["log"].position_w.shape[1:] == (2, 3)
    assert "success_rate " in said.getvalue()
    plt.close("all")
