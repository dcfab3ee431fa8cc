"""Shipped policies as their users export them: from the command line, compared on recorded flights."""

import pytest

from cruise.cli.main import main


@pytest.mark.parametrize("name", ["racer-ring", "racer-uzh-2026"])
def test_the_command_writes_a_model_that_does_the_same(name, tmp_path, capsys):
    path = tmp_path / "policy.onnx"
    assert main(["export", name, "--onnx", str(path)]) == 0
    assert "of the policy in" in capsys.readouterr().out
    assert path.stat().st_size > 10_000
