"""Terms of a user: they are seen, they pay, they are written down; what makes no sense is one line."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import RewardWeights
from cruise.env.observation import OBSERVATIONS, add_observation, find_observation, for_any_field
from cruise.env.payment import make_reward
from cruise.env.race_env import make_race_env
from cruise.env.types import stage_rules
from cruise.errors import CruiseError
from cruise.presets import CURRICULUM, TRACKS, VEHICLES
from cruise.terms import Entry, Observation, RewardTerm, Setting, Term, difference
from tests.helpers import arrays

SPEED = Term(
    "speed", 1, "own speed", "m/s", 2.0, low=0.0, high=1.5, fn=lambda view: jnp.sqrt((view.velocity_w**2).sum(0))
)


@pytest.mark.parametrize("base", ["paper", "extended", "body"])
@pytest.mark.parametrize("vehicle", ["paper", "racer"])
def test_more_terms_come_after_those_of_another_observation(base, vehicle, request):
    name = f"more_{base}_{vehicle}"
    add_observation(find_observation(base).with_terms(name, SPEED))
    request.addfinalizer(lambda: OBSERVATIONS.pop(name, None))
    env = make_race_env(TRACKS["ring"], 3, VEHICLES[vehicle], name)
    state = env.reset(jax.random.key(0), (5,))
    velocity = jnp.asarray(np.random.default_rng(0).normal(size=(3, 3, 5), scale=2.0), jnp.float32)
    state = state._replace(drones=state.drones._replace(body=state.drones.body._replace(velocity_w=velocity)))
    plain, more = (np.asarray(jax.jit(env.observe_as[one])(state)) for one in (base, name))
    np.testing.assert_allclose(more[:-1], plain, atol=1e-6)
    speed = np.linalg.norm(velocity, axis=0)
    np.testing.assert_allclose(more[-1], np.clip(speed / 2, 0, 1.5), atol=1e-6)
    assert env.layout(name) == (*env.layout(base), SPEED.entry)
    assert for_any_field(name) == for_any_field(base)
    action = jnp.ones((env.dynamics.action_size, 3, 5))
    np.testing.assert_array_equal(env.decode_as[name](state, action), env.decode_as[base](state, action))


@pytest.mark.parametrize("phase", ["flight", "passing", "interaction"])
def test_a_reward_term_pays_by_its_phase(phase):
    """Flight pays but where a gate is passed, passing only there, interaction always; a crash ends all of it."""
    term = RewardTerm("mine", phase, 0.25, lambda step: jnp.ones(step.airborne.shape))
    weights = RewardWeights()
    ours, theirs = make_reward(weights, (term,)), make_reward(weights)
    env = make_race_env(TRACKS["ring"], 2, VEHICLES["paper"], reward=ours)
    state = env.reset(jax.random.key(1), (8,))
    _, outcome = jax.jit(env.step)(state, jnp.zeros((3, 2, 8)), arrays(stage_rules(CURRICULUM[-1], 0.4)))
    components = {name: jnp.zeros((2, 4)) for name in outcome.components} | {"mine": jnp.full((2, 4), 0.25)}
    passed, ended = jnp.array([[False, True, False, True]] * 2), jnp.array([[False, False, True, True]] * 2)
    rules = stage_rules(CURRICULUM[-1], 0.4)
    counts = {"flight": [1, 0], "passing": [0, 1], "interaction": [1, 1]}[phase]
    earned = ours.total(rules, components, passed, ended) - theirs.total(rules, components, passed, ended)
    np.testing.assert_allclose(earned[0], [0.25 * counts[0], 0.25 * counts[1], 0, 0], atol=1e-6)
    counted = ours.counted(outcome)
    assert tuple(counted) == ours.names
    np.testing.assert_allclose(sum(counted.values()), outcome.reward, atol=1e-6)


def fault_of(make):
    with pytest.raises(CruiseError) as error:
        make()
    assert "\n" not in str(error.value)
    return str(error.value)


def test_what_makes_no_sense_is_one_line():
    fn = SPEED.fn
    setting = Setting(2, 5, None)
    assert "size" in fault_of(lambda: Term("x", 0, "", fn=fn))
    assert "scale" in fault_of(lambda: Term("x", 1, "", scale=0.0, fn=fn))
    assert "low" in fault_of(lambda: Term("x", 1, "", low=1.0, high=-1.0, fn=fn))
    assert "frame" in fault_of(lambda: Term("x", 1, "", frame="moon", fn=fn))
    assert "name" in fault_of(lambda: Term("a b", 1, "", fn=fn))
    assert "two terms" in fault_of(lambda: Observation("x", (SPEED, SPEED)).terms_for(setting))
    assert "expected a tuple" in fault_of(lambda: Observation("x", ()).terms_for(setting))
    assert "own" in fault_of(lambda: add_observation(Observation("paper", (SPEED,))))
    assert "--terms" in fault_of(lambda: find_observation("nobody knows"))
    assert "phase" in fault_of(lambda: RewardTerm("x", "landing", 1.0, fn))
    assert "weight" in fault_of(lambda: RewardTerm("x", "flight", float("nan"), fn))
    assert "another" in fault_of(lambda: make_reward(RewardWeights(), (RewardTerm("prog", "flight", 1.0, fn),)))


def test_a_term_of_another_size_than_declared_is_named(request):
    add_observation(Observation("wrong", (Term("heights", 2, "", fn=lambda view: view.position_w),)))
    request.addfinalizer(lambda: OBSERVATIONS.pop("wrong", None))
    env = make_race_env(TRACKS["ring"], 2, VEHICLES["paper"], "wrong")
    shapes = jax.eval_shape(env.reset, jax.random.key(0))
    assert "'heights'" in fault_of(lambda: jax.eval_shape(env.observe, shapes))


def test_layouts_differ_by_what_the_numbers_mean_not_by_the_words():
    entry = Entry("speed", 1, "own speed", "m/s", 2.0)
    assert difference((entry,), (Entry("speed", 1, "how fast", "m/s", 2.0),)) is None
    assert "scale" in difference((entry,), (Entry("speed", 1, "own speed", "m/s", 3.0),))
    assert "terms" in difference((entry,), (entry, entry))
