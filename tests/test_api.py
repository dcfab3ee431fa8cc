"""The Python face: everything named is there, importing is quick, and the functions do what the command does."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import cruise
from cruise import api_training
from cruise.config import TrainConfig
from cruise.errors import CruiseError
from cruise.racing import random_track
from cruise.racing.random_track import training_track
from cruise.training.session import Session
from tests.storage.logs import small_log

PILOTS = ["chaser", "hover"]


def test_importing_waits_for_nothing():
    command = "import sys, cruise; assert not {'jax', 'numpy', 'matplotlib'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", command], check=True, timeout=60)


def test_every_public_name_is_there_and_documented():
    assert set(cruise.__all__) <= set(dir(cruise))
    for name in cruise.__all__:
        assert getattr(cruise, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'fly'"):
        _ = cruise.fly


def test_race_and_evaluate():
    log = cruise.race("ring", 2, PILOTS, laps=1, seed=3)
    assert log.pilots.tolist() == PILOTS
    again = cruise.race(cruise.load_track("ring"), 2, PILOTS, laps=1, seed=3)
    np.testing.assert_array_equal(log.position_w, again.position_w)
    evaluation = cruise.evaluate("ring", 2, PILOTS, episodes=3, seed=5)
    assert evaluation.success_rate.mean == 0.5
    assert evaluation.to_dict()["policy"] == "chaser,hover"


def test_replay(tmp_path):
    log = small_log()
    assert cruise.replay(log, tmp_path / "one.html") == tmp_path / "one.html"
    cruise.replay([log, log], tmp_path / "two.html", labels=["before", "after"])
    page = (tmp_path / "two.html").read_text()
    assert page.count('"label":"before"') == page.count('"label":"after"') == 1
    with pytest.raises(CruiseError, match="a replay needs at least one race and a label for each, got 0 and 0"):
        cruise.replay([])


def test_a_policy_for_random_tracks_is_measured_on_unseen_ones(monkeypatch):
    """The tracks of its training are no measure; a run on any other track is measured on that track."""
    measured = []
    monkeypatch.setattr(
        api_training, "evaluate_policy", lambda policy, track, episodes, sensing: measured.append(track)
    )
    monkeypatch.setattr(api_training, "draw_training", lambda *_: None)
    monkeypatch.setattr(api_training, "read_metrics", lambda folder: [])
    monkeypatch.setattr(random_track, "TRAINING", 3)
    for name in ("random", "ring"):
        config = TrainConfig(track=name)
        run = object.__new__(Session)
        run.config, run.track, run.folder = config, training_track(config), Path()
        run.finish = lambda measure: measure(Path("policy")) or Path("policy")
        api_training.finish_run(run, 2)
    unseen, ring = measured
    trained = set(training_track(TrainConfig(track="random")).variants)
    assert len(unseen.variants) == random_track.UNSEEN
    assert not trained & set(unseen.variants)
    assert ring.name == "ring"
