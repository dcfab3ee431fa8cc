"""The same training on one device and on several."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import TrainConfig
from cruise.errors import CruiseError
from cruise.presets import TRACKS, VEHICLES
from cruise.training import devices
from cruise.training.trainer import Trainer
from cruise.training.types import TrainState
from tests.training.runs import ALL_LEARN, TINY, last_rules, moving, tiny_trainer

UPDATES = 2


def crashing(trainer: Trainer) -> TrainState:
    """A state in which many races begin anew, so that it matters which start each of them gets."""
    state = trainer.initial_state()
    return trainer.place(state._replace(races=moving(state.races, 0)))


def after_updates(trainer: Trainer) -> tuple[TrainState, dict[str, float]]:
    state = crashing(trainer)
    for _ in range(UPDATES):
        state, metrics = trainer.update(state, last_rules(), np.asarray(False))
    return state, {name: float(value) for name, value in metrics.items()}


@functools.cache
def on_devices(config: TrainConfig, count: int) -> tuple[TrainState, dict[str, float]]:
    trainer = tiny_trainer() if (config, count) == (TINY, 1) else None
    return after_updates(trainer or Trainer(config, TRACKS["ring"], VEHICLES["paper"], jax.devices()[:count]))


@pytest.mark.parametrize(("config", "count"), [(TINY, 2), (TINY, 4), (ALL_LEARN, 2)])
def test_several_devices_train_as_one_does(config, count):
    """Races, parameters and everything logged, but for the order in which sums are rounded."""
    (one, measured), (many, found) = on_devices(config, 1), on_devices(config, count)
    assert many.races.step.sharding.num_devices == count
    assert measured["terminated"] > 0.002  # in the last update alone
    assert found.keys() == measured.keys()
    for name, value in measured.items():
        assert found[name] == pytest.approx(value, rel=1e-3, abs=1e-4), name
    for a, b in zip(jax.tree.leaves((one.model, one.races)), jax.tree.leaves((many.model, many.races)), strict=True):
        np.testing.assert_allclose(b, a, atol=2e-3)


def test_a_state_goes_on_on_another_number_of_devices():
    """As after a resume: what a run on one device saved is trained on by two."""
    two = Trainer(TINY, TRACKS["ring"], VEHICLES["paper"], jax.devices()[:2])
    state = jax.tree.map(np.asarray, crashing(tiny_trainer())._replace(key=None))
    state = state._replace(key=jax.random.key(3))
    after, expected = (
        trainer.update(trainer.place(state), last_rules(), np.asarray(False))[0] for trainer in (two, tiny_trainer())
    )
    for a, b in zip(jax.tree.leaves(expected.model), jax.tree.leaves(after.model), strict=True):
        np.testing.assert_allclose(b, a, atol=1e-4)


@pytest.mark.parametrize(
    ("most", "races", "least", "expected"),
    [
        (1, 512, 64, 1),
        (2, 512, 64, 2),
        (6, 512, 64, 4),  # 5 and 6 do not divide 512
        (64, 512, 64, 8),
        (4, 32, 64, 1),  # not even one share is large enough
        (8, 32, 1, 8),
    ],
)
def test_races_are_shared_equally(most, races, least, expected):
    assert devices.shares(most, races, least) == expected


def test_by_default_the_first_devices_share_the_races():
    assert devices.choose_devices(4 * devices.LEAST_LEARNERS) == jax.devices()[:4]
    assert devices.choose_devices(3 * devices.LEAST_LEARNERS) == jax.devices()[:3]
    assert devices.choose_devices(1) == jax.devices()[:1]
    assert devices.choose_devices(devices.LEAST_LEARNERS, learners=2) == jax.devices()[:2]


@pytest.mark.parametrize(("count", "message"), [(0, "from 1 to 4"), (5, "from 1 to 4"), (3, "cannot share 64 races")])
def test_devices_that_are_not_there_are_refused(count, message):
    with pytest.raises(CruiseError, match=message):
        devices.choose_devices(64, count)
    assert devices.choose_devices(64, 2) == jax.devices()[:2]


def test_without_an_axis_a_mean_is_the_thing_itself():
    tree = {"a": jnp.arange(3.0)}
    assert devices.mean_over_devices(tree, None) is tree
