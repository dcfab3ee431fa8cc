"""A run's folder belongs to one process at a time, and keeps the track that the run is flown on."""

import contextlib
import copy
import dataclasses
import json
import os
import resource
from pathlib import Path

import pytest

from cruise.cli.line_up import usual_track
from cruise.cli.main import main
from cruise.config import Track
from cruise.errors import CruiseError
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.random_track import random_tracks
from cruise.racing.track_file import load_track, save_track
from cruise.storage.checkpoint import load_checkpoint, save_checkpoint
from cruise.storage.policy_file import read_meta, save_policy
from cruise.training import hosts
from cruise.training import session as session_module
from cruise.training.metrics_log import METRICS, MetricsLog, read_metrics
from cruise.training.run_track import TRACK, run_track
from cruise.training.session import CONFIG, LOCK, Session, resume_config
from tests.storage.policies import meta, random_params
from tests.storage.test_file_lock import free, held_elsewhere
from tests.training.runs import TINY, open_session, tiny_trainer, train

__all__ = ["open_session"]  # a fixture

MOVED = dataclasses.replace(TRACKS["ring"].gates[0], position_w=(9.0, 0.0, 4.0))
MINE = dataclasses.replace(TRACKS["ring"], name="mine", gates=(MOVED, *TRACKS["ring"].gates[1:]))


def test_two_processes_cannot_train_in_one_folder(open_session, tmp_path, capsys):
    """Neither when both begin, nor when both go on, nor when one begins where the other goes on."""
    folder = tmp_path / "run"
    folder.mkdir()
    words = f"another process is training in {folder}: wait for it, or choose another --out"
    with held_elsewhere(folder / LOCK), pytest.raises(CruiseError, match=words):
        open_session()
    assert os.listdir(folder) == [LOCK]
    open_session().close()
    before = sorted(os.listdir(folder))
    with held_elsewhere(folder / LOCK):
        with pytest.raises(CruiseError, match=words):
            open_session(resume=True)
        assert main(["train", "--resume", str(folder)]) == 2
        assert capsys.readouterr().err == f"error: {words}\n"
    assert sorted(os.listdir(folder)) == before


def test_a_folder_is_held_from_the_beginning_until_it_is_closed(open_session):
    session = open_session()
    assert not free(session.folder / LOCK)
    train(session)
    assert not free(session.folder / LOCK)  # the policy is still to be written
    session.finish(lambda _: {})
    session.close()
    assert free(session.folder / LOCK)


def test_a_command_lets_go_of_the_folder(open_session, monkeypatch):
    folder = open_session().folder
    monkeypatch.setattr("cruise.api_training.finish_run", lambda session, episodes: folder)
    assert main(["train", "--resume", str(folder)]) == 0
    assert free(folder / LOCK)


def test_what_the_first_process_cannot_do_fails_everywhere(monkeypatch):
    """As seen by the second of two processes."""
    monkeypatch.setattr(hosts, "is_first", lambda: False)
    monkeypatch.setattr(hosts, "agreed", lambda flag: True)
    with pytest.raises(CruiseError, match="the first process of this run could not go on"):
        hosts.on_first(lambda: pytest.fail("only the first does it"))
    monkeypatch.setattr(hosts, "agreed", lambda flag: False)
    assert hosts.on_first(lambda: pytest.fail("only the first does it")) is None


@pytest.fixture
def on_mine(tmp_path, monkeypatch):
    """Opens a run on `my.toml` of the working folder, on programs that are compiled for the ring."""

    def trainer(config, *_):
        ready = copy.copy(tiny_trainer())
        ready.config = config
        return ready

    monkeypatch.setattr(session_module, "Trainer", trainer)
    (tmp_path / "home").mkdir()
    monkeypatch.chdir(tmp_path / "home")
    save_track(MINE, "my.toml")
    config = dataclasses.replace(TINY, track="my.toml", seed=0)

    def open_it(track: Track, *, resume: bool = False) -> Session:
        return Session(tmp_path / "run", config, track, VEHICLES["paper"], resume=resume)

    return open_it


def test_a_run_keeps_its_track(on_mine, tmp_path, monkeypatch):
    """Whatever happens to the file, and from whatever folder it is asked for."""
    session = on_mine(load_track("my.toml"))
    session.close()
    folder = session.folder
    save_track(TRACKS["ring"], "my.toml")
    assert run_track(folder, resume_config(folder)) == MINE
    with pytest.raises(CruiseError, match=r"this run began on another track, that of .*track.toml"):
        on_mine(load_track("my.toml"), resume=True)
    monkeypatch.chdir(tmp_path)
    assert run_track(folder, resume_config(folder)) == MINE
    resumed = on_mine(run_track(folder, resume_config(folder)), resume=True)
    assert resumed.track == MINE


def test_resuming_takes_the_track_of_the_run(on_mine, tmp_path, monkeypatch):
    folder = on_mine(load_track("my.toml")).folder
    taken = []

    def stop(folder, config, track, *_, **__):
        taken.append(track)
        raise KeyboardInterrupt

    save_track(TRACKS["ring"], "my.toml")
    monkeypatch.setattr(session_module, "Session", stop)
    assert main(["train", "--resume", str(folder)]) == 130
    assert taken == [MINE]


def test_a_kept_track_that_was_changed_is_refused(on_mine):
    session = on_mine(load_track("my.toml"))
    save_track(TRACKS["ring"], session.folder / TRACK)
    with pytest.raises(CruiseError, match=r"track.toml has been changed since this run began: put it back"):
        on_mine(run_track(session.folder, session.config), resume=True)
    (session.folder / TRACK).unlink()
    with pytest.raises(CruiseError, match=r"track of the run .*track.toml does not exist"):
        on_mine(run_track(session.folder, session.config), resume=True)


def test_runs_from_before_keep_their_track_from_now_on(on_mine):
    """Their checkpoints know of no track; it is looked for where it was."""
    session = on_mine(load_track("my.toml"))
    state, told = load_checkpoint(session.folder, session.trainer.state_shape())
    save_checkpoint(session.folder, state, {key: value for key, value in told.items() if key != "track_sha256"})
    (session.folder / TRACK).unlink()
    on_mine(run_track(session.folder, session.config), resume=True)
    assert load_track(session.folder / TRACK) == MINE


def test_tracks_that_every_race_draws_anew_are_not_kept(open_session, tmp_path):
    from cruise.training.run_track import check_track, keep_track

    assert keep_track(tmp_path, random_tracks(0, 2)) == ""
    assert check_track(tmp_path, random_tracks(0, 2), "") == ""
    assert os.listdir(tmp_path) == []


def test_a_policy_knows_the_track_it_was_trained_on(on_mine, tmp_path, monkeypatch):
    """So that it can be raced from anywhere, even where a built-in track or a file has the same name."""
    session = on_mine(load_track("my.toml"))
    train(session, 1)
    session.finish(lambda _: {})
    Path("my.toml").unlink()
    monkeypatch.chdir(tmp_path)
    assert read_meta(session.folder).flown_on == MINE
    assert usual_track(read_meta(session.folder)) == MINE
    ring_like = dataclasses.replace(MINE, name="ring")
    save_policy("a", random_params(), meta(flown_on=ring_like))
    assert usual_track(read_meta("a")) == ring_like


def test_an_old_policy_takes_no_file_of_another_track(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    old = meta(track="mine", config={"track": "my.toml"})
    with pytest.raises(CruiseError, match="trained on track 'mine', not a built-in one: give its --track"):
        usual_track(old)
    save_track(MINE, "my.toml")
    assert usual_track(old) == MINE
    save_track(dataclasses.replace(MINE, name="yours"), "my.toml")
    with pytest.raises(CruiseError, match="trained on track 'mine', not a built-in one: give its --track"):
        usual_track(old)


def test_a_policy_with_an_unsound_track_is_refused(tmp_path):
    path = save_policy(tmp_path / "a", random_params(), meta(flown_on=MINE)).with_suffix(".json")
    text = json.loads(path.read_text())
    text["policy"]["flown_on"]["gates"][0]["width"] = -1.0
    path.write_text(json.dumps(text))
    with pytest.raises(CruiseError, match="flown_on: gate 1"):
        read_meta(path)


@contextlib.contextmanager
def disk_of(size: int):
    """No file can grow beyond so many bytes."""
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))


def test_a_full_disk_leaves_whole_rows(tmp_path):
    log = MetricsLog(tmp_path, 0)
    row = {"update": 1, "steps": 1024, "loss": 0.5}
    log.add(row)
    size = (tmp_path / METRICS).stat().st_size
    with disk_of(size + 5), pytest.raises(CruiseError, match=r"cannot write .*metrics.jsonl: File too large"):
        log.add(row)
    assert (tmp_path / METRICS).read_bytes().endswith(b"}\n")
    assert (tmp_path / METRICS).stat().st_size == size
    log.add(row)
    with disk_of(0):
        with pytest.raises(CruiseError, match="cannot write"):
            log.flush()
        log.close()
    assert read_metrics(tmp_path) == [row, row]


def test_a_full_disk_ends_training_with_one_line(open_session, capsys):
    folder = open_session().folder
    with disk_of(100):
        assert main(["train", "--resume", str(folder)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: cannot write ")
    assert error.endswith(": File too large\n")
    assert error.count("\n") == 1
    assert resume_config(folder) == TINY


def test_a_run_in_the_working_folder_is_called_after_it(open_session, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    session = open_session(folder=Path())
    session.finish(lambda _: {})
    assert read_meta(Path("policy")).name == "here/policy"
    assert (Path() / CONFIG).exists()
