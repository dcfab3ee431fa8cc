"""What a run leaves in its folder."""

import json
from dataclasses import replace

import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.pilots.neural import NeuralPilot
from cruise.presets import TRACKS, VEHICLES, training_config
from cruise.storage.checkpoint import CURRENT, PREVIOUS
from cruise.storage.config_file import load_config
from cruise.storage.policy_file import load_policy, read_meta, read_policy
from cruise.training import session as session_module
from cruise.training.initial_state import initial_state
from cruise.training.metrics_log import METRICS
from cruise.training.session import CONFIG, resume_config
from cruise.training.trainer import Trainer
from tests.training.runs import TINY, UPDATES, bits, open_session, tiny_trainer, train, uninterrupted, whole_run

__all__ = ["open_session", "uninterrupted"]  # fixtures


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


def test_the_command_to_go_on_can_be_pasted(open_session, tmp_path):
    assert open_session(folder=tmp_path / "my run").resume_command == f"cruise train --resume '{tmp_path}/my run'"


def test_every_stage_leaves_a_policy_that_flies_like_its_last_state(uninterrupted):
    folder = uninterrupted.folder
    for number, phase in enumerate(tiny_trainer().phases, start=1):
        pilot, meta = load_policy(folder / f"stage-{number}"), read_meta(folder / f"stage-{number}")
        assert isinstance(pilot, NeuralPilot)
        assert bits(pilot.params) == bits(whole_run()[phase.last_update - 1].state.policy)
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
    assert seen == [bits(whole_run()[-1].state.policy)] == [bits(load_policy(uninterrupted.folder).params)]
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


def test_a_run_can_start_from_a_policy(open_session, uninterrupted, tmp_path):
    """Everybody flies it at first, and learning goes on from there."""
    policy = uninterrupted.folder / "stage-5"
    session = open_session(folder=tmp_path / "on", start_from=str(policy))
    expected = bits(read_policy(policy).params)
    pool = session.state.opponents
    assert bits(session.state.model) == bits(pool.newest) == bits(pool.previous) == expected


def test_steps_before_a_run_are_told_even_after_a_stop(open_session, uninterrupted, tmp_path):
    policy = uninterrupted.folder / "stage-5"
    folder = tmp_path / "on"
    open_session(folder=folder, start_from=str(policy))
    session = open_session(folder=folder, start_from=str(policy), resume=True)
    for _ in session:
        pass
    meta = read_policy(session.finish(lambda path: {})).meta
    assert meta.steps_before == read_policy(policy).meta.steps > 0
    assert meta.all_steps == meta.steps_before + meta.steps


def test_a_best_response_learns_against_one_policy_that_never_changes(open_session, uninterrupted, tmp_path):
    champion = uninterrupted.folder / "stage-5"
    session = open_session(folder=tmp_path / "response", against=str(champion))
    for progress in session:
        assert not progress.opponents_replaced
    expected = bits(read_policy(champion).params)
    assert bits(session.state.opponents.newest) == bits(session.state.opponents.previous) == expected
    assert bits(session.state.model) != expected


def test_a_policy_can_learn_to_see_less_but_not_be_flown_so():
    """The same numbers, some of which fade: it goes on from there, but opponents are flown as they were trained."""
    usual = replace(training_config("racer", 2), critic_observation="")
    config = replace(usual, observation="body-near", start_from="racer-ring", ppo=replace(usual.ppo, races=64))
    trainer = Trainer(config, TRACKS["ring"], VEHICLES["racer"])
    assert bits(initial_state(trainer).model) == bits(read_policy("racer-ring").params)
    trainer.config = replace(config, against="racer-ring")
    with pytest.raises(CruiseError, match="by the body observation, this run trains for a racer by the body-near one"):
        initial_state(trainer)


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ("racer-ring", "flies a racer by the body observation, this run trains for a paper by the extended one"),
        ("ring-2", "other networks than this run: give --hidden"),
        ("nowhere", "nowhere"),
    ],
)
@pytest.mark.parametrize("flag", ["start_from", "against"])
def test_a_policy_that_does_not_fit_is_refused_and_leaves_no_run(open_session, tmp_path, policy, words, flag):
    with pytest.raises(CruiseError, match=words):
        open_session(folder=tmp_path / "on", **{flag: policy})
    assert not (tmp_path / "on" / "config.json").exists()
