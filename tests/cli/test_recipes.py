"""Shipped policies are made by the Makefile: its flags are those that they were trained with."""

import shlex
import subprocess
from pathlib import Path

import pytest

from cruise.cli.main import parse
from cruise.storage.config_file import to_data
from cruise.storage.policy_file import list_policies
from tests.helpers import flat

ROOT = Path(__file__).parents[2]


def flags_of(name: str) -> list[str]:
    """Of the training that makes a policy, as `make` would run it."""
    command = ["make", "--dry-run", "--always-make", f"runs/{name}/policy.json"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    (line,) = [line for line in told.replace("\\\n", " ").splitlines() if f"--out runs/{name} " in f"{line} "]
    return shlex.split(line.partition("cruise train")[2])


@pytest.mark.parametrize("name", list_policies())
def test_the_flags_in_the_makefile_are_those_of_the_policy(name):
    chosen = parse(["train", *flags_of(name)])
    asked = flat(to_data(chosen.config))
    trained = flat(list_policies()[name].config)  # without the options that came later
    assert {key: asked[key] for key in trained} == trained
