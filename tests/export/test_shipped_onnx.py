"""Shipped policies as their users export them: by the command in a process of its own, compared on recorded flights."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("name", ["racer-ring", "racer-uzh-2026"])
def test_the_command_writes_a_model_that_does_the_same(name, tmp_path):
    path = tmp_path / "policy.onnx"
    command = [sys.executable, "-m", "cruise", "export", name, "--onnx", str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "of the policy in" in run.stdout
    assert path.stat().st_size > 10_000
