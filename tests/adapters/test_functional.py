"""The race as pure functions, in every layout: one and the same."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import cruise
from cruise.adapters.per_race import of_one_race
from cruise.errors import CruiseError

RACES, STEPS = 3, 14
TWO = {"track": "ring", "drones": 2, "episode_steps": 6}


def seeds(first):
    """The keys of the races that Gymnasium and PettingZoo fly with these seeds."""
    return jax.vmap(lambda seed: jax.random.fold_in(jax.random.key(seed), 0))(first + jnp.arange(RACES))


@pytest.fixture(scope="module")
def flown():
    """Races last: observations, rewards, ends of all steps, and what was seen before new races began."""
    env = cruise.make(**TWO)
    actions = jax.random.uniform(jax.random.key(1), (STEPS, 3, 2, RACES), minval=-1.0)

    def step(state, action):
        seen, state, *told = env.step(jax.random.key(0), state, action)
        return state, (seen, *told)

    @jax.jit
    def fly():
        first, state = env.reset(seeds(7))
        return first, jax.lax.scan(step, state, actions)[1]

    first, told = fly()
    return env, actions, first, told


def test_it_flies_what_pettingzoo_flies(flown):
    env, actions, first, (seen, reward, terminated, truncated, info) = flown
    zoo = cruise.vector_parallel_env(RACES, **TWO)
    theirs, _ = zoo.reset(seed=7)
    np.testing.assert_allclose(first.transpose(1, 2, 0), np.stack([theirs[a] for a in env.agents]), atol=2e-5)
    for k in range(STEPS):
        told = zoo.step({a: np.asarray(actions[k, :, i].T) for i, a in enumerate(env.agents)})
        for ours, by_agent in ((reward, told[1]), (terminated, told[2]), (truncated, told[3])):
            np.testing.assert_allclose(ours[k], np.stack([by_agent[a] for a in env.agents]), atol=2e-4)
        np.testing.assert_allclose(seen[k].transpose(1, 2, 0), np.stack([told[0][a] for a in env.agents]), atol=2e-4)
        details = told[4][env.agents[0]]
        if "final_obs" in details:
            over = details["_final_obs"]
            np.testing.assert_array_equal(info["over"][k], over)
            np.testing.assert_allclose(info["final_observation"][k, :, 0, over], details["final_obs"][over], atol=2e-4)
    assert info["over"].sum() >= 2 * RACES


def test_agents_by_name_fly_the_same(flown):
    last, actions, first, (seen, reward, _, truncated, info) = flown
    env = cruise.make(**TWO, layout="agents")
    assert env.agents == last.agents == ["drone_0", "drone_1"]
    assert env.observation_space("drone_0").shape == first.shape[:1]
    assert env.action_space("drone_0").sample(jax.random.key(0)).shape == (3,)

    def step(state, action):
        named = {a: action[:, i].T for i, a in enumerate(env.agents)}
        told, state, *rest = jax.vmap(env.step)(jax.random.split(jax.random.key(0), RACES), state, named)
        return state, (told, *rest)

    @jax.jit
    def fly():
        told, state = jax.vmap(env.reset)(seeds(7))
        return told, jax.lax.scan(step, state, actions)[1]

    begun, (theirs, rewards, dones, details) = fly()
    for i, agent in enumerate(env.agents):
        np.testing.assert_allclose(begun[agent], first[:, i].T, atol=1e-5)
        np.testing.assert_allclose(theirs[agent], seen[:, :, i].swapaxes(1, 2), atol=2e-4)
        np.testing.assert_allclose(rewards[agent], reward[:, i], atol=2e-4)
        np.testing.assert_array_equal(dones[agent], info["done"][:, i])
    np.testing.assert_array_equal(dones["__all__"], info["over"])
    np.testing.assert_array_equal(details["truncated"], truncated.swapaxes(1, 2))


def test_a_new_start_every_time_and_none_depends_on_other_races():
    env = cruise.make("ring", 1, episode_steps=2)
    reset = jax.jit(env.reset)
    step = jax.jit(lambda state: env.step(jax.random.key(0), state, jnp.zeros((3, 1, len(state.pending)))))

    def starts(keys):
        seen, state = reset(keys)
        told = [np.asarray(seen)]
        for _ in range(6):
            seen, state, *_, info = step(state)
            if info["over"].any():
                told.append(np.asarray(seen))
        return np.stack(told)[..., 0, :]

    keys = seeds(3)
    many, alone = starts(keys), starts(keys[1:2])
    assert len({row.tobytes() for row in many.transpose(0, 2, 1).reshape(-1, many.shape[1])}) == 4 * RACES
    np.testing.assert_allclose(many[..., 1:2], alone, atol=1e-6)


def test_vmap_of_vmap_is_one_batch():
    calls = []

    def many(x, scale):
        calls.append(x.shape)
        return {"sum": x.sum(axis=0) * scale}

    one = of_one_race(many)
    x, scale = jnp.arange(24.0).reshape(2, 4, 3), jnp.arange(2.0)
    out = jax.vmap(jax.vmap(one, in_axes=(0, None)))(x, scale)["sum"]
    np.testing.assert_allclose(out, x.sum(axis=-1) * scale[:, None])
    assert calls[-1] == (3, 8)
    np.testing.assert_allclose(one(x[0, 0], scale[1])["sum"], x[0, 0].sum())


def test_one_learner_as_gymnax_has_it():
    env = cruise.make("ring", opponents=["chaser"], layout="single", episode_steps=2)
    seen, state = env.reset(jax.random.PRNGKey(0), env.default_params)
    assert seen.shape == env.observation_space(env.default_params).shape
    for last in (False, True):
        before = state
        told = env.step(jax.random.PRNGKey(1), before, jnp.zeros(3), env.default_params)
        new, state, reward, terminated, truncated, info = told
        assert (new.shape, reward.shape, terminated.shape, info["speed"].shape) == (seen.shape, (), (), ())
        assert (bool(terminated), bool(truncated)) == (False, last)
        assert (info["terminated"] == terminated) & (info["truncated"] == truncated)
        assert bool((info["final_observation"] == new).all()) != last


def test_refused():
    with pytest.raises(CruiseError, match='layout "single" is for one learner'):
        cruise.make("ring", 2, layout="single")
    with pytest.raises(CruiseError, match="unknown layout 'dense'; there are races-last, agents, single"):
        cruise.make(layout="dense")
    with pytest.raises(CruiseError, match="a pilot in plain Python cannot fly in a compiled program"):
        cruise.make("ring", opponents=[lambda view: [0.0, 0.0, 0.0]])
    with pytest.raises(CruiseError, match="unknown vehicle 'kite'"):
        cruise.make(vehicle="kite")
