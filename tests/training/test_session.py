"""Runs on disk: the same seed gives the same run, whatever interrupts it."""

import itertools
import json
import shutil
import signal
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.pilots.neural import NeuralPilot
from cruise.storage.checkpoint import CURRENT, PREVIOUS, load_meta
from cruise.storage.config_file import load_config
from cruise.storage.policy_file import load_policy, read_meta
from cruise.training import session as session_module
from cruise.training.session import CONFIG, METRICS, Interrupted, Session, read_metrics, resume_config
from tests.training.runs import (
    TINY,
    UPDATES,
    bits,
    open_session,
    saved_updates,
    shared_trainer,
    tiny_trainer,
    whole_run,
)

__all__ = ["open_session"]  # a fixture


def train(session: Session, updates: int | None = None) -> None:
    """Train to the end, or for so many updates and then drop everything, as a crash would."""
    for _ in itertools.islice(session, updates):
        pass


def train_with_ctrl_c(session: Session, update: int, times: int = 1) -> None:
    """Ctrl-C while the caller looks at that update."""
    for progress in session:
        for _ in range(times if int(progress.state.updates) == update else 0):
            signal.raise_signal(signal.SIGINT)


def rows_of(session: Session) -> list[dict]:
    """Everything logged but the clock."""
    return [{k: v for k, v in row.items() if k != "seconds"} for row in read_metrics(session.folder)]


@pytest.fixture
def uninterrupted(open_session, tmp_path) -> Session:
    session = open_session(folder=tmp_path / "uninterrupted")
    train(session)
    return session


def test_the_seed_is_the_run():
    again = shared_trainer(TINY)
    for progress, expected in zip(again.run(again.initial_state()), whole_run(), strict=True):
        assert bits(progress.state) == bits(expected.state)
        assert bits(progress.metrics) == bits(expected.metrics)
    first, other = whole_run()[0].state, whole_run(seed=1)[0].state
    assert bits(first.model.actor) != bits(other.model.actor)
    assert bits(first.races) != bits(other.races)


@pytest.mark.parametrize(
    "stops",
    [
        (0, 0),  # before the first update, twice
        (1, 4, 12, 23),  # at ends of stages and in evaluations
        (7, 8, 9, 30, 45, 46),  # in the middle; after the last one
    ],
)
def test_interrupted_runs_end_as_the_uninterrupted_one(stops, open_session, uninterrupted):
    session = open_session(seconds=1e-9)
    for stop in stops:
        train(session, stop - int(session.state.updates))
        session = open_session(seconds=1e-9, resume=True)
        assert int(session.state.updates) == stop
    train(session)
    assert bits(session.state) == bits(uninterrupted.state) == bits(whole_run()[-1].state)
    assert rows_of(session) == rows_of(uninterrupted)
    assert [row["update"] for row in rows_of(session)] == list(range(1, UPDATES + 1))
    seconds = [row["seconds"] for row in read_metrics(session.folder)]
    assert seconds == sorted(seconds)


def test_what_was_logged_after_the_checkpoint_is_dropped(open_session, uninterrupted):
    session = open_session()  # saves at the ends of stages only
    train(session, 20)
    with (session.folder / METRICS).open("a") as file:
        file.write('{"update": 21, "steps": 21504, "rew')
    assert [row["update"] for row in rows_of(session)] == list(range(1, 21))
    resumed = open_session(resume=True)
    at = int(resumed.state.updates)
    assert at == max(phase.last_update for phase in tiny_trainer().phases if phase.last_update <= 20)
    train(resumed, 1)
    assert [row["update"] for row in rows_of(resumed)] == list(range(1, at + 2))
    train(open_session(resume=True))
    assert (resumed.folder / METRICS).read_text().endswith("}\n")
    assert rows_of(resumed) == rows_of(uninterrupted)


@pytest.mark.parametrize("damage", ["cut", "garbage", "gone"])
def test_a_damaged_checkpoint_falls_back_to_the_one_before(damage, open_session, caplog):
    session = open_session(seconds=1e-9)
    train(session, 10)
    current = session.folder / CURRENT
    if damage == "gone":  # between the two renames of a save
        current.unlink()
    else:
        whole = current.read_bytes()
        current.write_bytes(whole[: len(whole) // 2] if damage == "cut" else b"\0" * len(whole))
    resumed = open_session(resume=True)
    assert int(resumed.state.updates) == 9
    assert (PREVIOUS in caplog.text) == (damage != "gone")
    train(resumed)
    assert bits(resumed.state) == bits(whole_run()[-1].state)


def test_a_new_folder_holds_a_checkpoint_before_it_holds_a_configuration(open_session, monkeypatch, tmp_path):
    """So that a run killed at any moment either can be resumed or has not begun."""
    order = []
    for name in ("save_checkpoint", "save_config"):
        original = getattr(session_module, name)
        monkeypatch.setattr(
            session_module, name, lambda *a, name=name, original=original: (order.append(name), original(*a))
        )
    session = open_session()
    assert order == ["save_checkpoint", "save_config"]
    assert resume_config(session.folder) == TINY
    (session.folder / CONFIG).unlink()
    assert int(open_session().state.updates) == 0  # what was left behind is in nobody's way


def test_checkpoints_are_never_older_than_the_interval(open_session, monkeypatch):
    """By a clock that ticks 0.7 s at every look: at any update less than the interval and one update are unsaved."""
    clock = itertools.count(step=0.7)
    monkeypatch.setattr(
        session_module, "time", SimpleNamespace(monotonic=lambda: next(clock), time=time.time, time_ns=time.time_ns)
    )
    session = open_session(seconds=5.0)
    saved = 0
    for progress in session:
        done = int(progress.state.updates)
        at = saved_updates(session.folder)
        rows = {row["update"]: row["seconds"] for row in read_metrics(session.folder)}
        assert rows[done] - rows.get(at, 0.0) < 5.0
        assert (at == done) or not progress.phase_ended
        saved += at == done
    assert 8 < saved < 30


def test_ctrl_c_saves_and_says_how_to_go_on(open_session):
    session = open_session()
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(Interrupted) as stop:
        train_with_ctrl_c(session, update=5)
    assert str(stop.value) == f"stopped after 5,120 steps; go on with: cruise train --resume {session.folder}"
    assert signal.getsignal(signal.SIGINT) == before
    resumed = open_session(resume=True)
    assert int(resumed.state.updates) == 5
    train(resumed)
    assert bits(resumed.state) == bits(whole_run()[-1].state)


def test_the_second_ctrl_c_acts_at_once(open_session):
    session = open_session()
    with pytest.raises(KeyboardInterrupt) as stop:
        train_with_ctrl_c(session, update=3, times=2)
    assert not isinstance(stop.value, Interrupted)
    assert saved_updates(session.folder) == 1  # the end of the first stage


def test_the_command_to_go_on_can_be_pasted(open_session, tmp_path):
    assert open_session(folder=tmp_path / "my run").resume_command == f"cruise train --resume '{tmp_path}/my run'"


def test_training_works_outside_the_main_thread(open_session):
    session = open_session()
    thread = threading.Thread(target=train, args=(session,))
    thread.start()
    thread.join()
    assert bits(session.state) == bits(whole_run()[-1].state)


def test_every_stage_leaves_a_policy_that_flies_like_its_last_state(uninterrupted):
    folder = uninterrupted.folder
    for number, phase in enumerate(tiny_trainer().phases, start=1):
        pilot, meta = load_policy(folder / f"stage-{number}"), read_meta(folder / f"stage-{number}")
        assert isinstance(pilot, NeuralPilot)
        assert bits(pilot.params) == bits(whole_run()[phase.last_update - 1].state.model)
        assert (meta.steps, meta.agility) == (phase.last_update * 1024, phase.stage.agility)
        assert (meta.track, meta.drones, meta.seed, meta.observation) == ("ring", 2, 0, "extended")
    assert load_config(folder / CONFIG, type(TINY)) == TINY


def test_finish_writes_the_policy_with_what_was_measured_of_it(uninterrupted):
    seen = []

    def measure(path) -> dict:
        seen.append(bits(load_policy(path).params))
        assert read_meta(path).results == {}
        return {"success_rate": {"mean": 0.5}}

    path = uninterrupted.finish(measure)
    assert path == uninterrupted.folder / "policy.safetensors"
    assert seen == [bits(whole_run()[-1].state.model)] == [bits(load_policy(uninterrupted.folder).params)]
    meta = read_meta(uninterrupted.folder)
    assert meta.results == {"success_rate": {"mean": 0.5}}
    assert meta.config["ppo"]["hidden"] == [16, 16]
    assert meta.steps == UPDATES * 1024


def test_rows_are_plain_finite_numbers(uninterrupted):
    text = (uninterrupted.folder / METRICS).read_text()
    rows = [json.loads(line, parse_constant=pytest.fail) for line in text.splitlines()]
    assert len(rows) == UPDATES
    for row, progress in zip(rows, whole_run(), strict=True):
        assert all(np.isfinite(value) for value in row.values())
        assert row["loss/value"] == float(progress.metrics["loss/value"])
        assert ("evaluation/win_rate" in row) == (progress.score is not None)
        assert row.get("evaluation/opponents_replaced", 0.0) == float(progress.opponents_replaced)
    assert not any("evaluation/lap_time" in row for row in rows)  # nobody flew a lap: not measured, so absent


def test_a_run_is_never_overwritten(open_session):
    session = open_session()
    train(session, 1)
    before = {path: path.read_bytes() for path in session.folder.rglob("*") if path.is_file()}
    with pytest.raises(CruiseError, match="holds a run already: go on with cruise train --resume"):
        open_session()
    assert {path: path.read_bytes() for path in session.folder.rglob("*") if path.is_file()} == before


def test_nothing_to_resume(open_session, tmp_path):
    with pytest.raises(CruiseError, match="no run to resume here"):
        resume_config(tmp_path)
    session = open_session()
    for name in (CURRENT, PREVIOUS):
        (session.folder / name).unlink(missing_ok=True)
    with pytest.raises(CruiseError, match="no checkpoint in"):
        open_session(resume=True)


def test_the_clock_goes_on_where_it_stopped(open_session):
    session = open_session(seconds=1e-9)
    train(session, 3)
    kept = load_meta(session.folder)
    assert kept["steps"] == 3 * 1024
    shutil.copytree(session.folder, session.folder.with_name("copy"))
    resumed = open_session(resume=True, folder=session.folder.with_name("copy"))
    assert resumed.seconds_before == kept["seconds"] > 0
