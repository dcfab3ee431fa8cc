"""`cruise train`: what a person sees, what is left on disk, and what happens to bad input."""

import io
import json
import random
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rich.console import Console
from tensorboardX.proto.event_pb2 import Event

from cruise.cli.main import main
from cruise.cli.progress import make_screen
from cruise.config import RewardWeights
from cruise.presets import REWARDS
from cruise.storage.checkpoint import CURRENT, PREVIOUS, load_checkpoint
from cruise.storage.config_file import load_config
from cruise.storage.policy_file import load_policy, read_meta
from cruise.training import session as session_module
from cruise.training.session import CONFIG, METRICS, read_metrics
from tests.training.replay import compiled_env
from tests.training.runs import (
    TINY,
    TINY_FLAGS,
    UPDATES,
    bits,
    open_session,
    saved_updates,
    shared_trainer,
    tiny_trainer,
    whole_run,
)

__all__ = ["open_session"]  # a fixture

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
    assert left == {*stages, *finished}
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
    assert bits(pilot.params) == bits(whole_run()[-1].state.model)
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


BROKEN_TRACK = 'name = "x"\n'
# What is typed, and what the one line says.
BAD_INPUT = {
    "no drones": ("--drones 0", "drones must be between 1 and 16, not 0"),
    "too many drones": ("--drones 17", "drones must be between 1 and 16, not 17"),
    "seed below zero": ("--seed -1", "seed must be between 0 and 4294967295, not -1"),
    "seed too large": ("--seed 4294967296", "seed must be between 0 and 4294967295, not 4294967296"),
    "minibatches": ("--minibatches 5", "rollout_steps (64) must be a multiple of minibatches (5)"),
    "no minibatches": ("--minibatches 0", "minibatches must be 1 or more, not 0"),
    "fewer races than steps": ("--races 32", "races (32) must be at least rollout_steps (64)"),
    "no epochs": ("--epochs 0", "epochs must be 1 or more, not 0"),
    "negative rate": ("--learning-rate -0.001", "learning_rate must be positive, not -0.001"),
    "rate nan": ("--learning-rate nan", "learning_rate must be a finite number, not nan"),
    "final rate": ("--final-learning-rate -1", "final_learning_rate must be 0 or more, not -1.0"),
    "gamma": ("--gamma 2", "gamma must be between 0 and 1, not 2.0"),
    "lambda": ("--gae-lambda -0.5", "gae_lambda must be between 0 and 1, not -0.5"),
    "entropy": ("--entropy-weight -1", "entropy_weight must be 0 or more, not -1.0"),
    "no layers": ("--hidden", "hidden must name the width of at least one layer"),
    "empty layer": ("--hidden 64 0", "hidden must name the width of at least one layer, each from 1 to 65536"),
    "huge layer": ("--hidden 99999999", "hidden must name the width of at least one layer, each from 1 to 65536"),
    "tiny budget": ("--step-scale 1e-9", "the budget is smaller than one update of 32,768 steps: raise step_scale"),
    "endless budget": ("--step-scale inf", "step_scale must be a finite number, not inf"),
    "no budget": ("--step-scale 0", "step_scale must be positive, not 0.0"),
    "weight nan": ("--w-prog nan", "w_prog must be a finite number, not nan"),
    "weight inf": ("--terminal -inf", "terminal must be a finite number, not -inf"),
    "tau": ("--win-threshold 1.5", "win_threshold must be between 0 and 1, not 1.5"),
    "patience": ("--patience -1", "patience must be 0 or more, not -1"),
    "evaluations": ("--evaluate-every 0", "evaluate_every must be 1 or more, not 0"),
    "episode": ("--episode-steps 0", "episode_steps must be 1 or more, not 0"),
    "distance": ("--collision-distance -1", "collision_distance must be positive, not -1.0"),
    "checkpoints": ("--checkpoint-seconds 0", "checkpoint_seconds must be positive, not 0.0"),
    "vehicle": ("--vehicle papre", "unknown vehicle 'papre': there are paper"),
    "track": ("--track rnig", "unknown track 'rnig': did you mean 'ring'?"),
    "track file": ("--track broken.toml", "broken.toml: "),
    "preset and weight": (
        "--reward-preset paper --w-prog 1",
        "--reward-preset paper and single reward weights exclude",
    ),
    "episodes": ("--episodes 0", "--episodes must be between 1 and 1000000, not 0"),
    "too many episodes": ("--episodes 2000000", "--episodes must be between 1 and 1000000, not 2000000"),
    "nothing to resume": ("--resume nowhere", "nowhere: no run to resume here, config.json is missing"),
    "unknown flag": ("--bogus 1", "--bogus"),
    "no number": ("--drones two", "two"),
    "no choice": ("--observation papre", "papre"),
    "no value": ("--gamma", "--gamma"),
    "no run in the folder": ("--resume .", "no run to resume here, config.json is missing"),
}


def tree(folder: Path) -> dict[str, bytes | None]:
    """Everything below a folder."""
    return {str(path): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys) -> Callable[..., str]:
    """Runs a command that must fail, leave no trace and say one line, which it gives back."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(session_module, "Trainer", shared_trainer)

    def refuse(*arguments: str) -> str:
        before = tree(tmp_path)
        code = main(["train", *arguments])
        captured = capsys.readouterr()
        assert code == 2
        assert captured.out == ""
        assert "Traceback" not in captured.err
        assert captured.err.count("\n") == 1
        assert tree(tmp_path) == before
        return captured.err

    return refuse


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_gives_one_line_and_leaves_nothing(case, refused):
    arguments, expected = BAD_INPUT[case]
    Path("broken.toml").write_text(BROKEN_TRACK)
    error = refused(*arguments.split())
    assert error.startswith("error: ")
    assert expected in error


def test_a_folder_that_cannot_be_written(refused):
    Path("file").write_text("in the way")
    for folder in ("file", "file/run", "/proc/run", "/dev/null/run"):
        error = refused(*TINY_FLAGS, "--out", folder)
        assert error.startswith(f"error: cannot write {folder}/")


def test_a_folder_that_holds_a_run(refused, open_session):
    folder = open_session().folder
    error = refused(*TINY_FLAGS, "--out", str(folder))
    assert error.startswith(f"error: {folder} holds a run already: go on with cruise train --resume {folder}, or ")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{", "not valid JSON (line 1"),
        ("[]", "expected a JSON object"),
        ('{"drones": 2, "dornes": 3}', "unknown key 'dornes'"),
        ('{"drones": "two"}', "drones: expected an integer, got 'two'"),
        ('{"ppo": {"gamma": null}}', "ppo.gamma: expected a number, got None"),
        ('{"ppo": {"gamma": 3}}', "gamma must be between 0 and 1, not 3.0"),
        ('{"track": "nowhere.toml"}', "nowhere.toml: no such track file"),
        ("\0\1\2\xff", "not valid JSON"),
    ],
)
def test_a_broken_configuration_is_not_resumed(content, expected, refused, open_session):
    folder = open_session().folder
    (folder / CONFIG).write_text(content)
    assert expected in refused("--resume", str(folder))


def test_a_run_resumes_as_it_was_configured(refused, open_session):
    folder = str(open_session().folder)
    for flags in ("--drones 3", "--seed 1", "--gamma 0.9", "--out elsewhere", "--reward-preset paper", "--w-prog 1"):
        assert "--resume continues a run as it was configured" in refused("--resume", folder, *flags.split())


@pytest.mark.parametrize("damage", ["gone", "cut", "garbage", "foreign", "other size"])
def test_without_a_whole_checkpoint_nothing_is_resumed(damage, refused, open_session):
    folder = open_session().folder
    current = folder / CURRENT
    if damage == "gone":
        current.unlink()
    elif damage == "foreign":
        current.write_bytes(b"\2\0\0\0\0\0\0\0{}")
    elif damage == "other size":
        config = json.loads((folder / CONFIG).read_text())
        config["checkpoint_seconds"] = 5.0
        (folder / CONFIG).write_text(json.dumps(config))
        state, meta = load_checkpoint(folder, tiny_trainer().state_shape())
        session_module.save_checkpoint(folder, state._replace(restart=jnp.zeros(3, bool)), meta)
        (folder / PREVIOUS).unlink()
    else:
        whole = current.read_bytes()
        current.write_bytes(whole[:5000] if damage == "cut" else b"x" * len(whole))
    error = refused("--resume", str(folder))
    assert error.startswith("error: ")
    assert "checkpoint" in error


def test_the_papers_reward_is_one_flag(tmp_path, monkeypatch):
    """The printed weights reach the run's configuration."""
    taken = []

    def stop(folder, config, *_, **__):
        taken.append(config)
        raise KeyboardInterrupt

    monkeypatch.setattr(session_module, "Session", stop)
    assert main(["train", "--reward-preset", "paper", "--vanilla", "--self-play", "off"]) == 130
    assert main(["train", *TINY_FLAGS]) == 130
    assert taken[0].reward == REWARDS["paper"] != RewardWeights()
    assert (taken[0].vanilla, taken[0].opponents.self_play) == (True, "off")
    assert taken[1] == TINY.__class__(**{**vars(TINY), "checkpoint_seconds": 30.0})


def test_ctrl_c_while_the_policy_is_measured(open_session, monkeypatch, capsys):
    session = open_session()
    for _ in session:
        pass

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("cruise.api_training.finish_run", interrupt)
    assert main(["train", "--resume", str(session.folder)]) == 130
    assert capsys.readouterr().err == f"error: interrupted; go on with: cruise train --resume {session.folder}\n"


def test_the_panel_of_a_terminal():
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, color_system=None, width=140)
    with make_screen(console, TINY, tiny_trainer().total_steps) as screen:
        for progress in whole_run():
            screen.show(progress)
    text = file.getvalue()
    assert "training ring, 2 drones, seed 0: 47,104 steps" in text
    for number in range(1, 6):
        assert f"stage {number} done after" in text
    assert "Advanced III" in text
    assert "success" in text


def test_lines_say_where_the_run_stands(capsys):
    with make_screen(Console(file=io.StringIO()), TINY, tiny_trainer().total_steps) as screen:
        for progress in whole_run():
            screen.show(progress)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "training ring, 2 drones, seed 0: 47,104 steps"
    ends = [progress for progress in whole_run() if progress.phase_ended]  # all of it takes less than 10 s
    assert [line.split()[1:4:2] for line in lines[1:]] == [[str(p.phase.number), f"{p.steps:,}"] for p in ends]
