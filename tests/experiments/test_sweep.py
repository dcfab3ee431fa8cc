"""Jobs through Ray: each ends once, a worker that is killed is followed by another, results land in the study."""

import os
import signal
import subprocess
import sys

import pytest

from cruise.cli.compilation import prepare_training
from cruise.cli.main import main
from cruise.errors import CruiseError
from experiments.plan import Job
from experiments.results import ResultFolder
from experiments.study import Event
from experiments.sweep import Cluster, run_job, sweep
from experiments.work import Work
from tests.experiments.test_miniature import CRUISE, SCALE

pytest.importorskip("ray")
JOBS = tuple(Job("cruise", "ring", 2, seed) for seed in range(3))
RACES = Job("head-to-head", "ring", 2, 0)


@pytest.fixture
def work(tmp_path):
    return Work(SCALE, ResultFolder(tmp_path / "results"), tmp_path / "runs")


def nothing(cores):
    """In place of what gets a worker ready to train."""


def note(work, job):
    """Remembers in a file that it ran; dies in the midst of the second job, the first time."""
    work.folder.mkdir(exist_ok=True)
    with (work.folder / "log").open("a") as log:
        log.write(f"{job.name}\n")
    if job == JOBS[1] and (work.folder / "log").read_text().count(job.name) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if job == JOBS[2]:
        raise RuntimeError("a defect of the program")
    return Event(job, "done")


def test_every_job_ends_once_and_races_come_last(work):
    events = list(sweep(work, (RACES, *JOBS), Cluster(cores=1), nothing, note))
    assert {event.job: event.what for event in events[:3]} == dict(zip(JOBS, ("done", "done", "failed"), strict=True))
    assert (events[3].job, events[3].what) == (RACES, "done")
    failed = next(event for event in events if event.what == "failed")
    assert "a defect of the program" in failed.message
    ran = (work.folder / "log").read_text().split()
    assert ran.count(JOBS[1].name) == 2  # killed, and tried again
    assert ran[-1] == RACES.name


def test_a_real_training_lands_where_reproduce_reads_it(work):
    (event,) = sweep(work, (CRUISE,), Cluster(cores=1), prepare_training)
    assert (event.job, event.what) == (CRUISE, "done"), event.message
    result = work.results.read(CRUISE)
    assert result is not None
    assert result.config["drones"] == 2
    assert work.results.policy_of(CRUISE).with_suffix(".safetensors").exists()
    assert run_job(work, CRUISE) == Event(CRUISE, "done")  # a worker that died after it wrote is followed by this


def test_workers_find_the_experiments_whatever_folder_a_sweep_starts_in(tmp_path):
    words = ["sweep", "--quick", "--only", "head-to-head", "ring", "2"]
    script = f"import sys; from cruise.cli.main import main; sys.exit(main({words!r}))"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "ring-2-head-to-head-s0: failed: needs the policy of ring-2-cruise-s0" in done.stdout


def test_more_cores_than_there_are(work):
    with pytest.raises(CruiseError, match=r"^--cores must be between 1 and \d+, .*, not 100000$"):
        list(sweep(work, JOBS, Cluster(cores=100_000), nothing, note))


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ("--seeds 0", "--seeds must be between 1 and 100, not 0"),
        ("--only crusie", "--only 'crusie' fits nothing"),
        ("--quick --address 127.0.0.1:1", "no Ray cluster answers at 127.0.0.1:1: "),
        ("--quick --address nowhere", "--address must be HOST:PORT or auto, not 'nowhere'"),
        ("--quick --cores 0", "--cores must be between 1 and"),
    ],
)
def test_bad_input_gives_one_line(flags, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", *flags.split()]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {expected}")
    assert error.count("\n") == 1
