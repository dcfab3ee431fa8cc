"""Runs on disk: the same seed gives the same run, whatever interrupts it."""

import itertools
import shutil
import signal
import threading
from types import SimpleNamespace

import pytest

from cruise.storage.checkpoint import CURRENT, PREVIOUS, load_meta
from cruise.training import session as session_module
from cruise.training.metrics_log import METRICS, read_metrics
from cruise.training.session import Interrupted, Session
from tests.training.runs import (
    TINY,
    UPDATES,
    bits,
    open_session,
    rows_of,
    saved_updates,
    shared_trainer,
    tiny_trainer,
    train,
    uninterrupted,
    whole_run,
)

__all__ = ["open_session", "uninterrupted"]  # fixtures


def train_with_ctrl_c(session: Session, update: int, times: int = 1) -> None:
    """Ctrl-C while the caller looks at that update."""
    for progress in session:
        for _ in range(times if int(progress.state.updates) == update else 0):
            signal.raise_signal(signal.SIGINT)


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


def test_checkpoints_are_never_older_than_the_interval(open_session, monkeypatch):
    """By a clock that ticks 0.7 s at every look: at any update less than the interval and one update are unsaved."""
    clock = itertools.count(step=0.7)
    monkeypatch.setattr(session_module, "time", SimpleNamespace(monotonic=lambda: next(clock)))
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


def test_training_works_outside_the_main_thread(open_session):
    session = open_session()
    thread = threading.Thread(target=train, args=(session,))
    thread.start()
    thread.join()
    assert bits(session.state) == bits(whole_run()[-1].state)


def test_the_clock_goes_on_where_it_stopped(open_session):
    session = open_session(seconds=1e-9)
    train(session, 3)
    kept = load_meta(session.folder)
    assert kept["steps"] == 3 * 1024
    shutil.copytree(session.folder, session.folder.with_name("copy"))
    resumed = open_session(resume=True, folder=session.folder.with_name("copy"))
    assert resumed.seconds_before == kept["seconds"] > 0
