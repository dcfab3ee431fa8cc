"""`cruise train`: what a person sees, what is left on disk, and what happens to bad input."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import pytest
from rich.console import Console

from cruise.cli.main import main
from cruise.cli.progress import make_screen
from cruise.config import RewardWeights
from cruise.presets import REWARDS
from cruise.storage.checkpoint import CURRENT, PREVIOUS, load_checkpoint
from cruise.training import session as session_module
from cruise.training.run_track import TRACK
from cruise.training.session import CONFIG
from tests.training.runs import (
    TINY,
    TINY_FLAGS,
    open_session,
    shared_trainer,
    tiny_trainer,
    whole_run,
)

__all__ = ["open_session"]  # a fixture

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
    "entropy after the end": ("--entropy-hold 1.5", "entropy_hold must be between 0 and 1, not 1.5"),
    "entropy ends first": (
        "--entropy-hold 0.8 --entropy-end 0.2",
        "entropy_end (0.2) must not be below entropy_hold (0.8)",
    ),
    "noise below nothing": ("--least-noise -1", "least_noise must be between 0 and 1, not -1.0"),
    "no noise left": ("--least-noise 0", "least_noise must be above 0"),
    "caution": ("--caution-distance -2", "caution_distance must be 0 or more, not -2.0"),
    "company": ("--company-distance -1", "company_distance must be 0 or more, not -1.0"),
    "no layers": ("--hidden", "hidden must name the width of at least one layer"),
    "empty layer": ("--hidden 64 0", "hidden must name the width of at least one layer, each from 1 to 65536"),
    "huge layer": ("--hidden 99999999", "hidden must name the width of at least one layer, each from 1 to 65536"),
    "tiny budget": ("--step-scale 1e-9", "the budget is smaller than one update of 32,768 steps: raise step_scale"),
    "endless budget": ("--step-scale inf", "step_scale must be a finite number, not inf"),
    "no budget": ("--step-scale 0", "step_scale must be positive, not 0.0"),
    "weight nan": ("--w-prog nan", "w_prog must be a finite number, not nan"),
    "weight inf": ("--terminal -inf", "terminal must be a finite number, not -inf"),
    "tau": ("--win-threshold 1.5", "win_threshold must be between 0 and 1, not 1.5"),
    "sparring": ("--sparring-share 1.1", "sparring_share must be between 0 and 1, not 1.1"),
    "milder races": ("--milder-share -0.1", "milder_share must be between 0 and 1, not -0.1"),
    "nominal races": ("--nominal-share 2", "nominal_share must be between 0 and 1, not 2.0"),
    "patience": ("--patience -1", "patience must be 0 or more, not -1"),
    "evaluations": ("--evaluate-every 0", "evaluate_every must be 1 or more, not 0"),
    "episode": ("--episode-steps 0", "episode_steps must be 1 or more, not 0"),
    "distance": ("--collision-distance -1", "collision_distance must be positive, not -1.0"),
    "checkpoints": ("--checkpoint-seconds 0", "checkpoint_seconds must be positive, not 0.0"),
    "vehicle": ("--vehicle papre", "unknown vehicle 'papre': did you mean 'paper'? built-in vehicles: paper, racer"),
    "track": ("--track rnig", "unknown track 'rnig': did you mean 'ring'?"),
    "track file": ("--track broken.toml", "broken.toml: "),
    "preset and weight": (
        "--reward-preset paper --w-prog 1",
        "--reward-preset paper and single reward weights exclude",
    ),
    "episodes": ("--episodes 0", "--episodes must be between 1 and 1000000, not 0"),
    "too many episodes": ("--episodes 2000000", "--episodes must be between 1 and 1000000, not 2000000"),
    "randomise": ("--vehicle racer --randomise 3", "--randomise must be from 0 to 2, not 3"),
    "randomise by a word": ("--randomise much", "--randomise must be from 0 to 2, not much"),
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
    (folder / TRACK).unlink()  # as in runs from before they kept their tracks
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
