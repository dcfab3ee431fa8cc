"""Running a plan: what is done is kept, what is left is run, nothing stops the rest."""

import dataclasses
import multiprocessing

import pytest

from cruise.errors import CruiseError
from cruise.pilots.se_ibr.options import Style
from cruise.storage.config_file import to_data
from experiments import study
from experiments.plan import Job, config_of, full_scale, make_plan
from experiments.results import ResultFolder
from experiments.study import left, run_jobs, state_of
from experiments.work import Step, Work
from tests.experiments.invented import invent_cell, invent_meetings

SCALE = dataclasses.replace(full_scale(1), races=4, tracks=("ring",), drones=(2,))
PLAN = make_plan(SCALE)
CRUISE, VANILLA, MEETING = (Job(kind, "ring", 2, 0) for kind in ("cruise", "vanilla", "head-to-head"))


@pytest.fixture
def work(tmp_path) -> Work:
    return Work(SCALE, ResultFolder(tmp_path / "results"), tmp_path / "runs")


@pytest.fixture
def made(monkeypatch) -> list[Job]:
    """Jobs that were run, by makers that invent their results."""
    jobs: list[Job] = []

    def make(work, job):
        yield Step("making", 0, 2)
        yield Step("making", 1, 2)
        jobs.append(job)
        work.results.write(job, (invent_meetings if job.family == "head-to-head" else invent_cell)(job, work.scale))

    monkeypatch.setattr(study, "MAKERS", dict.fromkeys(study.MAKERS, make))
    return jobs


def run_all(work: Work) -> list:
    return list(run_jobs(work, left(work, PLAN)))


def test_everything_is_run_once_and_in_order(work, made):
    events = run_all(work)
    assert tuple(made) == PLAN
    assert [e.what for e in events] == ["started", "step", "step", "done"] * len(PLAN)
    assert run_all(work) == []
    assert tuple(made) == PLAN


@pytest.mark.parametrize("steps", [1, 5, 6, 18])
def test_a_study_that_is_stopped_goes_on_with_what_is_left(work, made, steps):
    running = run_jobs(work, left(work, PLAN))
    events = [next(running) for _ in range(steps)]
    running.close()
    done = [e.job for e in events if e.what == "done"]
    assert made == done
    run_all(work)
    assert tuple(made) == PLAN  # nothing twice, nothing left out


def test_ctrl_c_reaches_the_caller_and_keeps_what_is_done(work, made, monkeypatch):
    def interrupted(work, job):
        raise KeyboardInterrupt
        yield

    monkeypatch.setitem(study.MAKERS, "planner", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_all(work)
    assert made == [CRUISE, VANILLA]
    assert [state_of(work, job) for job in made] == ["done", "done"]


def test_one_that_fails_does_not_stop_the_others(work, made, monkeypatch):
    def failing(work, job):
        yield Step("making")
        raise CruiseError("there is no such pilot")

    monkeypatch.setitem(study.MAKERS, "planner", failing)
    events = run_all(work)
    failed = [e for e in events if e.what == "failed"]
    assert {e.message for e in failed} == {"there is no such pilot"}
    assert {e.job.family for e in failed} == {"planner"}
    assert set(made) == {job for job in PLAN if job.family != "planner"}
    assert left(work, PLAN) == tuple(e.job for e in failed)


def hold(work: Work, ready, release) -> None:
    with work.lock(CRUISE):
        ready.set()
        release.wait(60)


def test_a_job_that_another_process_runs_is_left_to_it(work, made):
    context = multiprocessing.get_context("spawn")
    ready, release = context.Event(), context.Event()
    other = context.Process(target=hold, args=(work, ready, release))
    other.start()
    try:
        assert ready.wait(60)
        events = list(run_jobs(work, (CRUISE, VANILLA)))
        assert [(e.job, e.what) for e in events if e.what in ("busy", "done")] == [(CRUISE, "busy"), (VANILLA, "done")]
    finally:
        release.set()
        other.join()
    assert [e.what for e in run_jobs(work, (CRUISE, VANILLA))][-1] == "done"
    assert made == [VANILLA, CRUISE]


def test_another_configuration_is_seen_and_run_only_when_asked(work, made):
    run_all(work)
    longer = dataclasses.replace(SCALE.base(2), episode_steps=SCALE.base(2).episode_steps + 1)
    other = dataclasses.replace(work, scale=dataclasses.replace(SCALE, change=lambda _: longer))
    assert state_of(other, CRUISE) == "other settings"
    assert left(other, PLAN) == ()
    assert set(left(other, PLAN, again=True)) == {job for job in PLAN if job.family == "learned"}
    assert other.run_folder(CRUISE) != work.run_folder(CRUISE)


def test_a_planner_that_was_tuned_anew_is_seen(work, made, monkeypatch):
    run_all(work)
    tuned, paper = Job("se-ibr-tuned", "ring", 2, 0), Job("se-ibr", "ring", 2, 0)
    faster = Style(9.0, 1.5)
    monkeypatch.setattr("cruise.pilots.se_ibr.settings.tuned_style", lambda track: faster)
    assert [state_of(work, job) for job in (tuned, paper)] == ["other settings", "done"]


def test_options_that_came_later_change_nothing(work):
    cell = invent_cell(CRUISE, SCALE)
    older = {name: value for name, value in cell.config.items() if name != "observation"}
    nested = cell.config | {"ppo": {k: v for k, v in cell.config["ppo"].items() if k != "gamma"}}
    for config in (older, nested, cell.config | {"gone": 1}, cell.config | {"checkpoint_seconds": 1.0}):
        work.results.write(CRUISE, dataclasses.replace(cell, config=config))
        assert state_of(work, CRUISE) == "done"
    partners = {k: v for k, v in cell.config["opponents"].items() if k != "sparring_share"}  # it marks an era
    work.results.write(CRUISE, dataclasses.replace(cell, config=cell.config | {"opponents": partners}))
    assert state_of(work, CRUISE) == "other settings"
    changed = to_data(config_of(CRUISE, SCALE)) | {"seed": 5}
    work.results.write(CRUISE, dataclasses.replace(cell, config=changed))
    assert state_of(work, CRUISE) == "other settings"


def test_races_of_policies_that_were_replaced_are_out_of_date(work, made):
    run_all(work)
    assert state_of(work, MEETING) == "done"
    path = work.results.policy_of(CRUISE)
    path.parent.mkdir(parents=True)
    path.with_name(f"{path.name}.safetensors").write_bytes(b"another policy")
    assert state_of(work, MEETING) == "other settings"


def test_a_broken_result_is_seen_and_made_anew_only_when_asked(work, made):
    run_all(work)
    work.results.file_of(VANILLA).write_text("{")
    assert state_of(work, VANILLA) == "broken"
    assert left(work, PLAN) == ()
    assert left(work, PLAN, again=True) == (VANILLA,)
    list(run_jobs(work, (VANILLA,)))
    assert state_of(work, VANILLA) == "done"
