"""Where the commands come from."""

import os
import subprocess
import sys

import pytest

import cruise
from cruise.cli.main import main


@pytest.mark.parametrize("command", ["reproduce", "sweep"])
def test_outside_a_checkout_one_line_says_so(command, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cruise, "__file__", str(tmp_path / "lib" / "site-packages" / "cruise" / "__init__.py"))
    assert main([command, "--quick"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: `cruise reproduce` and `cruise sweep` need a checkout of CRUISE")
    assert error.count("\n") == 1


def test_in_a_checkout_they_are_found_from_any_folder(tmp_path):
    words = ["reproduce", "--list", "--only", "cruise", "ring", "2", "s0"]
    script = f"import sys; from cruise.cli.main import main; sys.exit(main({words!r}))"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "1 not run" in done.stdout


def test_a_device_that_is_not_there_is_told_in_one_line(tmp_path):
    command = [sys.executable, "-m", "cruise", "reproduce", "--quick", "--only", "cruise", "ring", "2", "s0"]
    command += ["--work", str(tmp_path / "work"), "--results", str(tmp_path / "results")]
    environment = {**os.environ, "JAX_PLATFORMS": "cuda"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 2
    assert done.stderr.startswith("error: JAX cannot use JAX_PLATFORMS=cuda")
    assert done.stderr.count("\n") == 1
