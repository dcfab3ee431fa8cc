"""Races flown and learned from with a memory and a value network that sees more than the policy."""

import copy
import functools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import PPOConfig, Randomisation, SelfPlayConfig, TrainConfig
from cruise.env.surroundings import perceive
from cruise.errors import CruiseError
from cruise.evaluation.matches import make_match
from cruise.presets import TRACKS, VEHICLES
from cruise.rollout import fly_from, team_rules
from cruise.storage.checkpoint import load_checkpoint, save_checkpoint
from cruise.storage.policy_file import load_policy, read_policy, save_policy
from cruise.training.experience import draw, make_collect
from cruise.training.initial_state import initial_state
from cruise.training.trainer import Trainer
from cruise.training.types import TrainState
from cruise.training.validation import check_config
from tests.storage.policies import meta, random_params
from tests.training.runs import bits, moving, random_model

RACES, STEPS = 8, 4
CONFIG = TrainConfig(
    drones=2,
    critic_observation="paper",
    step_scale=0.0001,
    episode_steps=6,
    ppo=PPOConfig(races=RACES, rollout_steps=STEPS, minibatches=2, epochs=1, network="gru", memory_size=5, hidden=(6,)),
    opponents=SelfPlayConfig(evaluation_races=4, evaluation_steps=3, sparring_share=0.0),
    randomisation=Randomisation(position_error=0.2),
)


@functools.cache
def trainer() -> Trainer:
    """On two devices, so that memories are spread as races are."""
    return Trainer(CONFIG, TRACKS["ring"], VEHICLES["paper"], jax.devices()[:2])


@functools.cache
def collector():
    env = trainer().env
    drawer = functools.partial(draw, env, config=CONFIG)
    return jax.jit(make_collect(env, CONFIG)), jax.jit(drawer)


def under_way(remembered: float, restart: bool) -> TrainState:
    """Races in which every network remembers `remembered` everywhere."""
    state = trainer().initial_state()
    model, opponent = (random_model(seed, state.model) for seed in range(2))
    pool = state.opponents._replace(newest=opponent, previous=opponent)
    memories = jax.tree.map(lambda leaf: jnp.full_like(leaf, remembered), (state.carries, state.opponents_carry))
    state = state._replace(model=model, opponents=pool, carries=memories[0], opponents_carry=memories[1])
    return state._replace(races=moving(state.races, 0), restart=jnp.full(RACES, restart))


def collected(state: TrainState):
    collect, drawer = collector()
    rules = trainer().rules_of(trainer().phases[-1])
    return collect(state, drawer(jax.random.key(1)), rules, jnp.asarray(False))


def test_a_race_that_begins_anew_remembers_nothing():
    """Neither the learner, nor its value network, nor the opponents; races under way remember."""
    fresh, other = (collected(under_way(remembered, restart=True)) for remembered in (0.0, 0.8))
    np.testing.assert_array_equal(fresh[1].transitions.value, other[1].transitions.value)
    np.testing.assert_array_equal(fresh[1].transitions.action, other[1].transitions.action)
    assert bits((fresh[0].races, fresh[0].carries, fresh[0].opponents_carry)) == bits(
        (other[0].races, other[0].carries, other[0].opponents_carry)
    )
    going_on = collected(under_way(0.8, restart=False))[1].transitions
    assert np.abs(going_on.value - collected(under_way(0.0, restart=False))[1].transitions.value).max() > 0.01
    np.testing.assert_array_equal(going_on.begins[0], np.zeros(RACES, bool))
    np.testing.assert_array_equal(going_on.begins[1:], going_on.terminated[:-1])


def test_the_value_network_sees_the_truth_and_the_policy_what_is_measured():
    state = under_way(0.0, restart=False)
    lived, env = collected(state)[1].transitions, trainer().env
    np.testing.assert_allclose(lived.judged[0], env.observe_as["paper"](state.races)[:, 0], atol=1e-5)
    np.testing.assert_allclose(lived.observation[0], env.observe(perceive(state.races))[:, 0], atol=1e-5)
    assert np.abs(lived.observation[0] - env.observe(state.races)[:, 0]).max() > 0.01


def test_what_was_lived_is_what_the_sequence_says():
    """Values and densities of a rollout, again by the unrolled networks from where it began."""
    state = under_way(0.5, restart=False)
    _, experience = collected(state)
    lived = experience.transitions
    mean, value = state.model.unroll(experience.carries, lived.observation, lived.judged, lived.begins)
    np.testing.assert_allclose(value, lived.value, atol=1e-4)
    noise = (lived.action - jnp.moveaxis(mean, 1, 0)) / lived.noise_scale[:, None]
    white = collector()[1](jax.random.key(1)).noise[:, :, 0]
    np.testing.assert_allclose(noise / jnp.exp(state.model.log_std)[:, None], white, atol=1e-3)


def test_a_resumed_run_is_the_run(tmp_path):
    """Memories are part of a checkpoint; the next update is the same bit for bit."""
    state, rules = trainer().place(under_way(0.5, restart=False)), trainer().rules_of(trainer().phases[-1])
    state, _ = trainer().update(state, rules, np.asarray(False))
    assert np.asarray(state.carries.actor).any()
    save_checkpoint(tmp_path, state, {})
    resumed = trainer().place(load_checkpoint(tmp_path, trainer().state_shape())[0])
    assert bits(resumed) == bits(state)
    after, again = (trainer().update(begun, rules, np.asarray(False))[0] for begun in (state, resumed))
    assert bits(after) == bits(again)
    assert bits(after.model) != bits(state.model)


def a_policy(tmp_path, **shape):
    params = random_params(drones=2, kind="gru", memory_size=5, **shape)
    return save_policy(tmp_path / "remembers", params, meta(drones=2)), params


def test_a_file_keeps_both_networks_and_says_what_they_are(tmp_path):
    path, params = a_policy(tmp_path, critic_observation_size=7)
    again = read_policy(path).params
    assert bits(again) == bits(params)
    assert (again.shape.kind, again.shape.memory_size, again.shape.critic_observation_size) == ("gru", 5, 7)
    assert read_policy("ring-4").params.shape.kind == "mlp"  # written before there were others


def test_every_race_has_a_memory_of_its_own(tmp_path):
    """Three races at once are three races one by one, memories and all; a new race begins without one."""
    path, _ = a_policy(tmp_path)
    pilot = load_policy(path)
    env = make_match(TRACKS["ring"], 2, path).env
    state = env.reset(jax.random.key(3), (3,))
    team = [pilot] * 2

    def flown(state, races):
        return fly_from(env, team, team_rules(team, 0.25, 0, (races,)), state, jax.random.key(0), 20, chunk=20).action

    together = flown(state, 3)
    for race in range(3):
        one = jax.tree.map(lambda x, race=race: x[..., race : race + 1], state)
        alone = flown(one, 1)
        np.testing.assert_allclose(together[: len(alone), ..., race], alone[..., 0], atol=1e-3)
    assert np.asarray(pilot.init(env, (0, 1), state)).shape == (5, 2, 3)
    assert not np.asarray(pilot.init(env, (0, 1), state)).any()


def test_a_value_network_learns_on_from_what_it_saw(tmp_path):
    """Never from another observation that happens to be as long."""
    shape = trainer().initial_state().model.shape
    sizes = {"critic_observation_size": shape.critic_observation_size}
    params = random_params(drones=2, kind="gru", memory_size=5, hidden=(6,), **sizes)
    for seen in ("", "body", "paper"):
        config = replace(CONFIG, critic_observation=seen)
        path = save_policy(tmp_path / f"saw-{seen}", params, meta(drones=2, config=config))
        begun = copy.copy(trainer())
        begun.config = replace(CONFIG, start_from=str(path))
        if seen == "paper":
            assert bits(initial_state(begun).model) == bits(params)
            continue
        told = f"give --critic-observation {seen or repr(seen)}"
        with pytest.raises(CruiseError, match=told):
            initial_state(begun)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"ppo": replace(CONFIG.ppo, minibatches=3)}, "races \\(8\\) must be a multiple of minibatches \\(3\\)"),
        ({"ppo": replace(CONFIG.ppo, memory_size=0)}, "memory_size must be from 1 to 65536, not 0"),
        ({"critic_observation": "everything"}, "unknown observation 'everything'; there are extended, paper"),
    ],
)
def test_what_cannot_work_is_refused(changes, complaint):
    with pytest.raises(CruiseError, match=complaint):
        check_config(replace(CONFIG, **{"step_scale": 1.0} | changes))


def test_every_device_needs_whole_minibatches():
    many = replace(CONFIG, ppo=replace(CONFIG.ppo, minibatches=8))
    with pytest.raises(CruiseError, match="every device needs a multiple of minibatches"):
        Trainer(many, TRACKS["ring"], VEHICLES["paper"], jax.devices()[:2])
