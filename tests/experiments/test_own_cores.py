"""Cores that a process keeps to itself: no two hold the same, and all are let go."""

import json
import os
import subprocess
import sys

import pytest

from experiments.own_cores import own_cores

pytestmark = pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no process is held to a core here")
OTHER = """
import json, os
from experiments.own_cores import own_cores
with own_cores(1) as cores:
    print(json.dumps([list(cores), list(os.sched_getaffinity(0))]), flush=True)
    input()
"""


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    """Other tests, and trainings, may hold cores of this machine."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))


def test_the_process_is_held_to_as_many_and_let_go():
    before = os.sched_getaffinity(0)
    with own_cores(1) as cores:
        assert len(cores) == 1
        assert os.sched_getaffinity(0) == cores
    assert os.sched_getaffinity(0) == before


def test_processes_hold_different_cores_until_they_end():
    before = os.sched_getaffinity(0)
    if len(before) < 2:
        pytest.skip("one core")
    piped = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", OTHER], **piped) as it:
        taken, held = json.loads(it.stdout.readline())
        assert len(taken) == 1
        assert held == taken
        with own_cores(1) as mine:
            assert len(mine) == 1
            assert mine.isdisjoint(taken)
        with own_cores(len(before)) as all_of_them:
            assert all_of_them == frozenset()  # one is taken
            assert os.sched_getaffinity(0) == before
        it.kill()  # it cannot tidy up
    with own_cores(len(before)) as all_of_them:
        assert all_of_them == before
