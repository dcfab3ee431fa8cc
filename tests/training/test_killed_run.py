"""A real run that is killed, goes on, is stopped by Ctrl-C, goes on to its end; and everything that it leaves."""

import random
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import pytest
from tensorboardX.proto.event_pb2 import Event

from cruise.storage.checkpoint import CURRENT, PREVIOUS, load_checkpoint
from cruise.storage.config_file import load_config
from cruise.storage.policy_file import load_policy, read_meta
from cruise.training.metrics_log import METRICS, read_metrics
from cruise.training.run_track import TRACK
from cruise.training.session import CONFIG, LOCK
from tests.training.replay import compiled_env
from tests.training.runs import TINY, TINY_FLAGS, UPDATES, bits, saved_updates, tiny_trainer, whole_run

CRUISE = [sys.executable, "-c", "import sys; from cruise.cli.main import main; sys.exit(main())"]


def start(*arguments: str) -> subprocess.Popen[str]:
    """`cruise` in a process of its own, with pipes instead of a terminal."""
    return subprocess.Popen([*CRUISE, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for_rows(folder: Path, rows: int, process: subprocess.Popen[str]) -> None:
    """Until so many updates have been logged."""
    end = time.monotonic() + 240
    while len(read_metrics(folder)) < rows and process.poll() is None:
        assert time.monotonic() < end, "training does not get under way"
        time.sleep(0.001)


class Story(NamedTuple):
    """A run that was killed, went on, was stopped by Ctrl-C, and went on to its end."""

    folder: Path
    moment: int  # number of the update at which it was killed
    logged: int  # updates in the log then
    kept: int  # updates in the checkpoint then
    stopped: tuple[int, str, str]  # exit code, output and errors of the process that Ctrl-C stopped
    resumed_at: int
    ended: tuple[int, str, str]


@pytest.fixture(scope="module")
def story(tmp_path_factory) -> Story:
    folder = tmp_path_factory.mktemp("story") / "run"
    moment = random.SystemRandom().randint(1, UPDATES // 2)
    with start("train", *TINY_FLAGS, "--checkpoint-seconds", "0.001", "--out", str(folder)) as process:
        wait_for_rows(folder, moment, process)
        process.kill()
    logged, kept = len(read_metrics(folder)), saved_updates(folder)
    with start("train", "--resume", str(folder)) as process:
        wait_for_rows(folder, logged + 2, process)
        process.send_signal(signal.SIGINT)
        stopped = outcome(process)
    resumed_at = saved_updates(folder)
    with start("train", "--resume", str(folder), "--episodes", "2") as process:
        ended = outcome(process)
    return Story(folder, moment, logged, kept, stopped, resumed_at, ended)


def outcome(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit code, output and errors of a process, when it has ended."""
    output, errors = process.communicate(timeout=300)
    return process.returncode, output, errors


def test_a_killed_run_ends_as_the_uninterrupted_one(story):
    assert story.ended[0] == 0, story
    state, _ = load_checkpoint(story.folder, tiny_trainer().state_shape())
    assert bits(state) == bits(whole_run()[-1].state), f"killed at update {story.moment}"
    rows = read_metrics(story.folder)
    assert [row["update"] for row in rows] == list(range(1, UPDATES + 1))
    for row, progress in zip(rows, whole_run(), strict=True):
        assert {name: row[name] for name in progress.metrics} == {k: float(v) for k, v in progress.metrics.items()}


def test_a_killed_run_loses_at_most_what_was_being_saved(story):
    assert story.moment <= story.logged <= UPDATES
    assert story.kept in (story.logged - 1, story.logged)
    assert story.kept <= story.resumed_at


def test_ctrl_c_says_how_to_go_on(story):
    code, _, errors = story.stopped
    assert code == 130
    steps = f"{story.resumed_at * 1024:,}"
    assert errors == f"error: stopped after {steps} steps; go on with: cruise train --resume {story.folder}\n"


def test_without_a_terminal_there_are_plain_lines(story):
    code, output, errors = story.ended
    assert (code, errors) == (0, "")
    assert "\x1b" not in output
    assert "\r" not in output
    first, *progress, policy, curves, measure, race = output.splitlines()
    assert first == "training ring, 2 drones, seed 0: 47,104 steps"
    assert all(line.startswith("stage ") for line in progress)
    assert "stage 5  100%       47,104 steps" in progress[-1]
    assert "win rate" in progress[-1]
    assert policy == f"policy   {story.folder}/policy.safetensors"
    assert curves == f"curves   {story.folder}/training.png"
    assert measure.startswith("measure  cruise evaluate --track ring --drones 2 --policy ")
    assert race.startswith("race     cruise race --track ring --drones 2 --policy ")


def test_everything_is_there_at_the_end(story):
    folder = story.folder
    stages = [f"stage-{k}{ending}" for k in range(1, 6) for ending in (".json", ".safetensors")]
    finished = [CONFIG, METRICS, "policy.json", "policy.safetensors", "tensorboard", "training.png", CURRENT, PREVIOUS]
    left = {path.name for path in folder.iterdir() if not path.name.endswith(".tmp")}  # drafts of the killed process
    assert left == {*stages, *finished, TRACK, LOCK}
    assert load_config(folder / CONFIG, type(TINY)).ppo == TINY.ppo
    picture = (folder / "training.png").read_bytes()
    width, height = struct.unpack(">II", picture[16:24])
    assert picture.startswith(b"\x89PNG")
    assert min(width, height) > 500


def test_tensorboard_has_every_number(story):
    events = [event for path in sorted((story.folder / "tensorboard").iterdir()) for event in events_in(path)]
    scalars = {}
    for event in events:
        for value in event.summary.value:
            scalars.setdefault(value.tag, {})[event.step] = value.simple_value
    for row in read_metrics(story.folder):
        for name in ("reward", "loss/policy", "policy/std"):
            assert scalars[name][row["steps"]] == pytest.approx(row[name])
    assert scalars["evaluation/win_rate"].keys() == {p.steps for p in whole_run() if p.score is not None}


def events_in(path: Path) -> list[Event]:
    """Records of an events file: length, checksum, message, checksum; the last may be cut short by the kill."""
    data, events, at = path.read_bytes(), [], 0
    while at + 12 <= len(data):
        (length,) = struct.unpack_from("<Q", data, at)
        message = data[at + 12 : at + 12 + length]
        at += length + 16
        if at <= len(data):
            events.append(Event.FromString(message))
    return events


def test_the_finished_policy_flies(story):
    pilot, meta = load_policy(story.folder), read_meta(story.folder)
    assert bits(pilot.params) == bits(whole_run()[-1].state.policy)
    results = meta.results
    assert (results["track"], results["drones"], results["episodes"]) == ("ring", 2, 2)
    assert 0 <= results["success_rate"]["mean"] <= 1
    assert results["seed"] == 0
    env = compiled_env()
    races = env.reset(jax.random.key(0), (64,))
    memory = pilot.init(env, (0, 1), races)
    _, action = pilot.act(env, (0, 1), memory, races, jax.random.key(1))
    assert action.shape == (3, 2, 64)
    assert np.isfinite(action).all()
    assert np.abs(action).max() <= 1
