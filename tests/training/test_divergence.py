"""A run whose numbers are no longer finite stops with one line, and nothing it leaves is poisoned."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.cli.main import main
from cruise.storage.checkpoint import CURRENT, load_checkpoint
from cruise.storage.policy_file import load_policy
from cruise.training import session as session_module
from cruise.training.metrics_log import read_metrics
from cruise.training.trainer import TrainingDiverged
from cruise.training.types import TrainState
from tests.training.runs import bits, open_session, saved_updates, shared_trainer, tiny_trainer, whole_run

__all__ = ["open_session"]  # a fixture


def poisoned(state: TrainState, value: float) -> TrainState:
    """One weight of the critic is `value`."""
    layer = state.model.critic.layers[0]
    weight = layer.weight.at[0, 0].set(value)
    return jax.tree.map(lambda x: weight if x is layer.weight else x, state)


def failing_at(update: int, value: float):
    """A trainer like the tiny run's whose parameters are spoilt by that update."""

    def make(*choices):
        trainer = shared_trainer(*choices)
        sound = trainer.update

        def spoilt(state, rules, alone):
            if int(state.updates) == update:
                return sound(poisoned(state, value), rules, alone)
            return sound(state, rules, alone)

        trainer.update = spoilt
        return trainer

    return make


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
@pytest.mark.parametrize("update", [0, 6, 11])  # the first; any; the last of a stage
def test_the_generator_stops_before_it_yields_anything_bad(update, value):
    trainer = failing_at(update, value)(tiny_trainer().config)
    seen = []
    with pytest.raises(TrainingDiverged, match=rf"is not finite after {(update + 1) * 1024:,} steps") as stop:
        seen.extend(trainer.run(trainer.initial_state()))
    assert len(str(stop.value).splitlines()) == 1
    assert [bits(p.state) for p in seen] == [bits(p.state) for p in whole_run()[:update]]


def test_a_norm_that_overflows_is_divergence_though_every_loss_is_finite():
    """Parameters may leave the numbers in the very last step of an update, after all losses were computed."""
    trainer = shared_trainer(tiny_trainer().config)
    metrics = dict(whole_run()[0].metrics)
    trainer.update = lambda *_: (whole_run()[0].state, metrics | {"policy/norm": jnp.asarray(jnp.inf)})
    with pytest.raises(TrainingDiverged, match="policy/norm is not finite"):
        next(trainer.run(trainer.initial_state()))


def test_the_norm_is_that_of_all_parameters():
    for progress in whole_run()[:3]:
        flat = np.concatenate([np.float64(leaf).ravel() for leaf in jax.tree.leaves(progress.state.model)])
        assert float(progress.metrics["policy/norm"]) == pytest.approx(np.linalg.norm(flat), rel=1e-5)


@pytest.mark.parametrize(("update", "left"), [(0, 0), (6, 6), (11, 11)])
def test_what_is_on_disk_is_the_last_good_state(update, left, open_session, monkeypatch):
    monkeypatch.setattr(session_module, "Trainer", failing_at(update, np.nan))
    session = open_session_with(session_module, open_session)
    with pytest.raises(TrainingDiverged) as stop:
        for _ in session:
            pass
    assert str(session.folder / CURRENT) in str(stop.value)
    assert len(str(stop.value).splitlines()) == 1
    state, meta = load_checkpoint(session.folder, session.trainer.state_shape())
    assert int(state.updates) == left
    assert meta["steps"] == left * 1024
    expected = whole_run()[left - 1].state if left else tiny_trainer().initial_state()
    assert bits(state) == bits(expected)
    assert [row["update"] for row in read_metrics(session.folder)] == list(range(1, left + 1))
    for path in session.folder.glob("stage-*.safetensors"):
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(load_policy(path).params))


def open_session_with(module, open_session):
    """Keep the failing trainer that was put in place after the fixture's."""
    failing = module.Trainer
    session = open_session(seconds=1e-9)
    assert module.Trainer is failing
    return session


def test_the_command_says_it_in_one_line_and_fails(open_session, monkeypatch, capsys):
    session = open_session(seconds=1e-9)
    for _ in itertools.islice(session, 6):
        pass
    monkeypatch.setattr(session_module, "Trainer", failing_at(8, np.nan))
    assert main(["train", "--resume", str(session.folder)]) != 0
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith("error: training diverged: ")
    assert f"the last good checkpoint is {session.folder / CURRENT}" in error
    assert not (session.folder / "policy.safetensors").exists()
    assert int(load_checkpoint(session.folder, session.trainer.state_shape())[0].updates) == 8


def test_an_absurd_learning_rate_is_told_in_one_line(tmp_path, capsys):
    flags = "--drones 1 --races 4 --rollout-steps 4 --minibatches 1 --epochs 1 --hidden 4 --step-scale 0.00002"
    folder = tmp_path / "run"
    assert main(["train", *flags.split(), "--learning-rate", "1e30", "--out", str(folder)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: training diverged: ")
    assert error.endswith(f"; the last good checkpoint is {folder / CURRENT}\n")
    assert error.count("\n") == 1
    assert saved_updates(folder) == 0
    assert read_metrics(folder) == []
