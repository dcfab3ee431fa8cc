"""The whole command on a tiny budget: training, planners, head-to-head races, report."""

import dataclasses
import itertools
import json

import pytest

from cruise.cli.main import main
from cruise.errors import CruiseError
from cruise.pilots.named import NAMED
from cruise.pilots.scripted import Chaser
from cruise.storage.policy_file import load_policy
from experiments import head_to_head
from experiments.learned import make_learned
from experiments.plan import Job, Scale, make_plan
from experiments.results import ResultFolder
from experiments.work import Work
from tests.training.runs import TINY, UPDATES

ENTRANTS = ("cruise", "vanilla", "se-ibr")
SCALE = Scale(
    "quick",
    lambda _: TINY,
    races=1,
    seeds=(0,),
    tracks=("ring",),
    kinds=(*ENTRANTS, "head-to-head"),
    drones=(TINY.drones,),
)
CRUISE = Job("cruise", "ring", TINY.drones, 0)


class Grounded(Chaser):
    """Fits no race."""

    def init(self, env, drones, state):
        raise CruiseError("it does not fly here")


@pytest.fixture
def study(monkeypatch, tmp_path):
    """Runs `cruise reproduce` on the tiny scale; a scripted pilot stands in for the planner, which compiles long."""
    monkeypatch.setattr("experiments.cli.quick_scale", lambda: SCALE)
    monkeypatch.setattr(head_to_head, "ENTRANTS", ENTRANTS)
    monkeypatch.setitem(NAMED, "se-ibr", Chaser(name="se-ibr", speed=4.0))
    folders = ["--work", str(tmp_path / "runs"), "--results", str(tmp_path / "results"), "--out", str(tmp_path / "out")]

    def run(*flags: str) -> int:
        return main(["reproduce", "--quick", *folders, *flags])

    return run


def test_from_nothing_to_the_report_and_again(study, tmp_path, capsys):
    assert study() == 0
    assert "report" in capsys.readouterr().out
    names = {path.stem for path in (tmp_path / "results" / "cells").iterdir()}
    assert names == {job.name for job in make_plan(SCALE) if job.family != "head-to-head"}
    cell = json.loads((tmp_path / "results" / "cells" / f"{CRUISE.name}.json").read_text())
    assert cell["steps"] == UPDATES * TINY.ppo.races * TINY.ppo.rollout_steps
    assert cell["curve"]["steps"][-1] == cell["steps"]
    assert [stage["stage"] for stage in cell["stages"]] == [1, 2, 3, 4, 5]
    assert cell["stages"][0]["agility"] == 2.0
    assert cell["origin"]["command"] == f"cruise reproduce --quick --only cruise ring {TINY.drones} s0"

    page = (tmp_path / "out" / "report.html").read_bytes()
    assert study("--report-only") == 0
    assert (tmp_path / "out" / "report.html").read_bytes() == page
    capsys.readouterr()
    assert study("--list") == 0
    assert f"{len(make_plan(SCALE))} done" in capsys.readouterr().out


def test_a_job_cut_short_in_training_ends_as_if_it_had_not_been(tmp_path):
    results = []
    for name, cut in (("whole", ()), ("cut", (7, 30))):
        work = Work(SCALE, ResultFolder(tmp_path / name / "results"), tmp_path / name / "runs")
        for steps in cut:
            making = make_learned(work, CRUISE)
            list(itertools.islice(making, steps))
            making.close()
            assert work.results.read(CRUISE) is None
        list(make_learned(work, CRUISE))
        results.append((work.results.read(CRUISE), work.results.checksum_of(CRUISE)))
        assert load_policy(work.results.policy_of(CRUISE)).drones == TINY.drones
    (whole, policy), (cut, other) = results
    assert policy == other
    for field in ("measured", "stages", "curve", "steps", "config"):
        assert getattr(whole, field) == getattr(cut, field), field


def test_a_pilot_that_cannot_fly(study, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(NAMED, "se-ibr", Grounded(name="se-ibr"))
    assert study("--only", "se-ibr") == 1
    out = capsys.readouterr().out
    assert "ring-2-se-ibr-s0: failed: it does not fly here" in out
    assert "1 failed: ring-2-se-ibr-s0; the same command tries again" in out


def test_races_wait_for_their_policies(study, capsys):
    assert study("--only", "head-to-head") == 1
    assert "ring-2-head-to-head-s0: failed: needs the policy of ring-2-cruise-s0" in capsys.readouterr().out


BAD_INPUT = {
    "no seeds": ("--seeds 0", "--seeds must be between 1 and 100, not 0"),
    "two things at once": ("--list --report-only", "--list, --report-only and --again exclude each other"),
    "unknown word": ("--only crusie", "--only 'crusie' fits nothing"),
    "no results": ("--report-only", "no results in results: name their folder with --results"),
    "a file in the way": ("--report-only --results empty --out taken", "cannot write taken/report.html"),
    "a broken result": ("--report-only --results broken", "result broken/cells/ring-2-cruise-s0.json: not valid JSON"),
    "no number": ("--seeds two", "two"),
}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_gives_one_line(case, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("")
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken" / "cells").mkdir(parents=True)
    (tmp_path / "broken" / "cells" / "ring-2-cruise-s0.json").write_text("{")
    flags, message = BAD_INPUT[case]
    assert main(["reproduce", *flags.split()]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ")
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert "Traceback" not in captured.err


def test_ctrl_c_says_how_to_go_on(study, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr("experiments.cli.run_jobs", interrupted)
    assert study() == 130
    assert "stopped; what is done is kept, and the same command goes on" in capsys.readouterr().err


def test_a_scale_is_told_by_its_steps():
    assert SCALE.steps == round(0.0012 * 40e6)
    assert dataclasses.replace(SCALE, change=lambda _: dataclasses.replace(TINY, step_scale=1.0)).steps == 40_000_000
