"""No key of random numbers serves twice: two draws from one key are one draw, and `fold_in(k, i)` is `split(k)[i]`."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.errors import KeyReuseError
from scipy.stats import spearmanr

from cruise.adapters.compiled import Plan, _draw
from cruise.config import Pole, SelfPlayConfig, Sensing, TrainConfig
from cruise.env.race_env import make_race_env
from cruise.env.randomise import made_for, perturbation
from cruise.presets import RANDOMISATION, TRACKS, VEHICLES
from cruise.racing.course import pick
from cruise.racing.random_track import random_tracks
from cruise.training.experience import draw
from cruise.training.random_keys import evaluation_keys
from cruise.training.trainer import Trainer
from tests.training.runs import TINY, tiny_trainer

DERIVE = ("split", "fold_in")
SAMPLE = ("uniform", "normal", "randint", "bits", "bernoulli", "gumbel", "permutation")


class Uses:
    """How often each key was made, split, folded and drawn from, by its numbers."""

    def __init__(self) -> None:
        self.made: Counter = Counter()
        self.used: Counter = Counter()  # split or drawn from
        self.folded: set = set()

    def faults(self) -> list[str]:
        """What no program may do."""
        twice = [f"{key} was made {n} times" for key, n in self.made.items() if n > 1]
        twice += [f"{key} was used {n} times" for key, n in self.used.items() if n > 1]
        return twice + [f"{key} was folded, and split or drawn from" for key in self.folded & set(self.used)]


def names(keys: jax.Array) -> list[tuple[int, ...]]:
    """The numbers of every key of an array; none where they are not known yet."""
    if isinstance(keys, jax.core.Tracer):
        return []
    data = np.asarray(jax.random.key_data(keys))
    return [tuple(row.tolist()) for row in data.reshape(-1, data.shape[-1])]


@contextmanager
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[Uses]:
    """Count what is done with keys by code that is not compiled."""
    uses = Uses()

    def watch(name: str) -> Callable:
        original = getattr(jax.random, name)

        def call(key, *args, **kwargs):
            result = original(key, *args, **kwargs)
            if name == "fold_in":
                uses.folded.update(names(key))
            else:
                uses.used.update(names(key))
            if name in DERIVE:
                uses.made.update(names(result))
            return result

        return call

    with monkeypatch.context() as patch:
        for name in (*DERIVE, *SAMPLE):
            patch.setattr(jax.random, name, watch(name))
        yield uses


def random_env(drones: int = 3, milder_share: float = 0.3):
    """Everything that can be random: vehicle, air, sensors, gates, solids, track, and how much of it."""
    track = dataclasses.replace(random_tracks(0, 3), obstacles=(Pole((0.0, 0.0, 0.0), 3.0, 0.2),))
    more = {"gate_tilt": 0.1, "solid_shift": 0.1, "extra_integral": 5.0, "extra_idle": 0.02, "extra_curve": 0.2}
    full = dataclasses.replace(RANDOMISATION["racer"], **more)
    vehicle = made_for(VEHICLES["racer"], full)
    shares = {"milder_share": milder_share, "nominal_share": milder_share}
    perturb = perturbation(track, vehicle, full, sensing=Sensing("camera"), **shares)
    return make_race_env(track, drones, vehicle, "body", perturb=perturb)


def test_a_start_uses_every_key_once(monkeypatch):
    with watched(monkeypatch) as uses:
        random_env().reset(jax.random.key(0), (4,), spread=0.5)
    assert len(uses.used) > 20
    assert uses.faults() == []


def test_a_rollouts_draws_use_every_key_once(monkeypatch):
    with watched(monkeypatch) as uses:
        opponents = SelfPlayConfig(vary_field=True, learners="all")
        draw(random_env(), jax.random.key(0), TrainConfig(opponents=opponents, spread_starts=0.5, retry_share=0.5))
    assert uses.faults() == []


def test_a_run_uses_every_key_once(monkeypatch):
    """From the seed to the draws of the first updates, and the evaluations after each."""
    trainer = Trainer(dataclasses.replace(TINY, seed=3), TRACKS["ring"], VEHICLES["paper"])
    with watched(monkeypatch) as uses:
        state = trainer._start(jax.random.key(3))
        key = state.key
        for _ in range(3):
            key, draws, shuffle = jax.random.split(key, 3)
            draw(trainer.env, draws, trainer.config)
            jax.random.split(shuffle, trainer.config.ppo.epochs)
    for update in range(3):
        uses.made.update(names(evaluation_keys(np.array([3, update], np.uint32))))
    assert uses.faults() == []


def test_the_watch_sees_the_faults(monkeypatch):
    key = jax.random.key(0)
    with watched(monkeypatch) as uses:
        jax.random.split(key, 4), jax.random.fold_in(key, 1)
    assert len(uses.faults()) == 2  # made twice; folded and split
    with watched(monkeypatch) as uses:
        jax.random.normal(key), jax.random.uniform(key)
    assert len(uses.faults()) == 1


def test_compiled_training_draws_from_no_key_twice():
    """JAX's own check, over a whole update and an evaluation: it sees what is compiled, not that two keys are equal."""
    trainer = tiny_trainer()
    shape, phase = trainer.state_shape(), trainer.phases[-1]
    rules, alone = trainer.rules_of(phase), np.asarray(phase.alone)
    with jax.debug_key_reuse(True):
        try:
            jax.jit(trainer._make_update()).trace(shape, rules, alone)
        except KeyReuseError as error:  # pragma: no cover  (the fault)
            pytest.fail(str(error))


def test_sparring_partners_know_nothing_of_the_learners_noise():
    """The speed of a run's partners says nothing of what the learner tries first, nor where it starts."""
    config = TrainConfig(drones=2, opponents=SelfPlayConfig(sparring_share=1.0), ppo=TINY.ppo)
    trainer = Trainer(dataclasses.replace(config, step_scale=0.01), TRACKS["ring"], VEHICLES["paper"])
    state = trainer.start(jax.random.key(0))
    _, draws_key, _ = jax.random.split(state.key, 3)
    draws = draw(trainer.env, draws_key, config)
    speed = np.asarray(state.sparring.speed[1])
    for other in (draws.noise[0, 0, 0], draws.noise[1, 2, 0], draws.start.drones.position_w[2, 0], state.races.step):
        assert abs(spearmanr(speed, np.asarray(other)).statistic) < 0.45  # 64 races: 3.6 standard deviations


def test_starts_know_nothing_of_what_is_random_about_them():
    env = random_env(1, milder_share=0.0)  # a milder race is milder in all
    state = env.reset(jax.random.key(0), (400,))
    height = (state.drones.position_w - pick(env.course_of(state).position_w, state.next_gate))[2]
    parameters, surroundings = state.drones.parameters, state.surroundings
    drawn = [parameters.mass, parameters.thrust_gain, parameters.delay, surroundings.errors.bias[0]]
    drawn += [surroundings.gusts.phase[0, 0][None], state.next_gate, height]
    rows = np.array([np.asarray(row).reshape(-1) for row in drawn])
    ranks = spearmanr(rows.T).statistic
    assert np.abs(ranks - np.eye(len(rows))).max() < 0.2  # 4 standard deviations


@pytest.mark.parametrize("race", [False, True])
def test_an_adapters_pilots_have_a_key_of_their_own(race):
    """What they draw from is no key that any later start of the races comes from."""
    plan = Plan(random_env(1), (), 0, (0,), "body", "disabled", jnp.int32(0), race=race)
    keys, found = jax.random.key_data(jax.random.split(jax.random.key(0), 3)).T, []
    for _ in range(2):
        keys, _, spare = _draw(plan, keys)
        here, theirs = (jax.random.wrap_key_data(data.T) for data in (keys, spare))
        found += names(theirs) + names(here)
        assert not set(found) & set(names(jax.vmap(lambda key: jax.random.split(key, 8))(here)))
    assert len(set(found)) == 12
