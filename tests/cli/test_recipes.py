"""Shipped policies are made by the Makefile: its flags are those that they were trained with."""

import dataclasses
import json
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cruise.cli.main import _parse
from cruise.storage.policy_file import list_policies

ROOT = Path(__file__).parents[2]


def flags_of(name: str) -> list[str]:
    """Of the training that makes a policy, as `make` would run it."""
    command = ["make", "--dry-run", "--always-make", f"runs/{name}/policy.json"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    (line,) = [line for line in told.replace("\\\n", " ").splitlines() if f"--out runs/{name} " in f"{line} "]
    return shlex.split(line.partition("cruise train")[2])


def flat(config: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in config.items():
        if isinstance(value, dict):
            yield from flat(value, f"{path}{name}.")
        else:
            yield path + name, value


@pytest.mark.parametrize("name", list_policies())
def test_the_flags_in_the_makefile_are_those_of_the_policy(name):
    chosen = _parse(["train", *flags_of(name)])
    asked = dict(flat(json.loads(json.dumps(dataclasses.asdict(chosen.config)))))
    trained = dict(flat(list_policies()[name].config))  # without the options that came later
    assert {key: asked[key] for key in trained} == trained
