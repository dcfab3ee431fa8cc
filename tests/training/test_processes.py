"""A run shared by two processes on this machine, one of which is lost; it goes on in the process that is left."""

import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.storage.policy_file import load_policy
from cruise.training import hosts
from cruise.training.metrics_log import read_metrics
from tests.training.runs import TINY_FLAGS, whole_run

PATIENCE = 600  # [s]; two processes compile at once
CRUISE = [sys.executable, "-c", "import sys; from cruise.cli.main import main; sys.exit(main())"]


def start(*arguments: str) -> subprocess.Popen:
    return subprocess.Popen([*CRUISE, "train", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def free_address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


def wait_for_updates(folder: Path, count: int, process: subprocess.Popen) -> None:
    deadline = time.monotonic() + PATIENCE
    while len(read_metrics(folder)) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_what_is_left_of_a_run_goes_on_to_the_same_policy(tmp_path):
    """Two processes, one killed; the other says so and stops; resumed alone, the run ends as if nothing had been."""
    folder = tmp_path / "run"
    shared = [*TINY_FLAGS, "--checkpoint-seconds", "0.001", "--out", str(folder), "--coordinator", free_address()]
    first, second = (start(*shared, "--process", f"{i}/2") for i in range(2))
    wait_for_updates(folder, 12, first)
    second.kill()
    second.communicate()
    _, said = first.communicate(timeout=PATIENCE)
    assert first.returncode != 0
    assert "Traceback" not in said
    complaint = next(line for line in said.splitlines() if line.startswith("error:"))
    assert re.search(r"a process of this run was lost .*go on with: cruise train --resume", complaint)
    assert len(read_metrics(folder)) < len(whole_run())

    alone = start("--resume", str(folder), "--episodes", "1")
    _, said = alone.communicate(timeout=PATIENCE)
    assert alone.returncode == 0, said
    found, expected = load_policy(folder).params, whole_run()[-1].state.policy
    for a, b in zip(jax.tree.leaves(expected.actor), jax.tree.leaves(found.actor), strict=True):
        np.testing.assert_allclose(b, a, atol=1e-3)


@pytest.mark.parametrize("process", ["2", "2/2", "a/b", "-1/2", "1/0"])
def test_a_process_is_a_number_of_how_many(process):
    with pytest.raises(CruiseError, match="--process must be i/n"):
        hosts.join("localhost:1234", process)


@pytest.mark.parametrize("coordinator", ["localhost", "localhost:", ":1234", "a b:1"])
def test_a_coordinator_is_a_host_and_a_port(coordinator):
    with pytest.raises(CruiseError, match="--coordinator must be host:port"):
        hosts.join(coordinator, "0/2")


def test_alone_everything_is_whole_and_agreed():
    tree = {"a": np.arange(3)}
    assert hosts.whole(tree) is tree
    assert hosts.from_first(tree, tree) is tree
    assert hosts.agreed(True)
    assert not hosts.agreed(False)
    assert hosts.is_first()
