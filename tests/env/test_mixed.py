"""Different vehicles in one race: each drone flies, collides and is logged as its own vehicle."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Randomisation
from cruise.env.mixed import as_one, each_of
from cruise.env.race_env import make_race_env
from cruise.env.randomise import perturbation
from cruise.env.types import race_rules
from cruise.errors import CruiseError
from cruise.evaluation.matches import make_match
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.grid import Start
from cruise.rollout import fly as fly_races
from cruise.rollout import team_rules
from cruise.storage.race_log import load_race_log
from cruise.storage.recorder import RaceInfo, race_logs
from cruise.vehicles import BATTERIES
from cruise.viewer.packing import pack_race
from tests.helpers import arrays, assert_trees_close

RING, RACER, PAPER = TRACKS["ring"], VEHICLES["racer"], VEHICLES["paper"]
HEAVY = dataclasses.replace(RACER, name="heavy", mass=1.3 * RACER.mass)
TOLD = dataclasses.replace(RACER, name="told", control="velocity")
AIR = dataclasses.replace(RACER.airframe, battery=BATTERIES["racer"], downwash=True, delay=0.03)
TIRED = dataclasses.replace(RACER, name="tired", airframe=AIR, substeps=4)
FLEET = (RACER, TOLD, TIRED, RACER)
RACES, STEPS = 2, 12
RULES = arrays(race_rules(RACER.agility, 0.05, 0))


def start(drones: int) -> Start:
    """Far apart, so that nobody's air moves another."""
    position = jnp.stack([jnp.linspace(-9.0, 9.0, drones), jnp.zeros(drones), jnp.full(drones, 3.0)])
    heading = jnp.zeros((drones, RACES))
    return Start(jnp.broadcast_to(position[:, :, None], (3, drones, RACES)), heading, jnp.zeros(RACES, jnp.int32))


def fly(fleet, action):
    env = make_race_env(RING, len(action[0]), fleet, "body")

    def run():
        def step(state, _):
            return env.step(state, action, RULES)[0], (state, env.observe(state))

        return jax.lax.scan(step, env.begin(start(len(action[0]))), length=STEPS)[1]

    return env, *jax.jit(run)()


def test_every_drone_flies_as_it_does_among_its_own_kind():
    action = jnp.stack([jnp.full((4, RACES), share) for share in (0.1, 0.2, -0.1, 0.15)])
    env, mixed, seen = fly(FLEET, action)
    assert env.dynamics.groups == ((0, 3), (1,), (2,))
    for group in env.groups:
        alone, states, own = fly(group.vehicle, action[: group.dynamics.action_size])
        assert alone.dynamics.groups is None
        for drone in group.drones:
            for vector, expected in zip(mixed.drones.body, states.drones.body, strict=True):
                np.testing.assert_allclose(vector[:, :, drone], expected[:, :, drone], atol=1e-5)
            np.testing.assert_allclose(seen[:, :18, drone], own[:, :18, drone], atol=1e-5)
    paths = np.asarray(mixed.drones.body.position_w)[-1, :, :, 0] - np.asarray(mixed.drones.body.position_w)[0, :, :, 0]
    assert np.abs(paths[:, 0] - paths[:, 1]).max() > 0.01
    assert len(env.observe(jax.tree.map(lambda leaf: leaf[-1], mixed))) == len(seen[0])


def test_memories_of_one_kind_are_one_array_again():
    env = make_race_env(RING, 3, (RACER, HEAVY, RACER))
    state = env.begin(start(3)).drones
    whole = as_one(env.groups, state)
    hover = [4 * one / 4 for one in (RACER.mass, HEAVY.mass, RACER.mass)]
    np.testing.assert_allclose(whole.memory.wrench[0, :, 0], 9.81 * np.array(hover), rtol=1e-5)
    assert as_one(env.groups[:1], state) is state


def test_each_is_random_about_its_own_numbers():
    spread = Randomisation(mass_spread=0.1, thrust_spread=0.1)
    draw = perturbation(RING, (RACER, HEAVY), spread)
    parameters = draw(jax.random.key(0), (2, 300)).parameters
    np.testing.assert_allclose(parameters.mass.mean(axis=1), [RACER.mass, HEAVY.mass], rtol=0.02)
    same = perturbation(RING, (RACER, RACER), spread)(jax.random.key(0), (2, 300)).parameters
    assert_trees_close(same, perturbation(RING, RACER, spread)(jax.random.key(0), (2, 300)).parameters)


def test_opponents_are_drawn_from_a_range_of_vehicles_and_the_learner_is_not():
    own, range_of = Randomisation(mass_spread=0.05), {"mass_spread": 0.3, "thrust_spread": 0.2}
    draw = perturbation(RING, RACER, own, rivals=range_of)
    parameters = draw(jax.random.key(0), (3, 400)).parameters
    mass, thrust = np.asarray(parameters.mass) / RACER.mass - 1, np.asarray(parameters.thrust_gain) - 1
    for values, learner, others in ((mass, 0.05, 0.3), (thrust, 0.0, 0.2)):
        assert 0.9 * learner <= np.abs(values[0]).max() <= learner + 1e-6
        assert (0.9 * others < np.abs(values[1:]).max(axis=1)).all()
        assert np.abs(values).max() <= others + 1e-6
    assert perturbation(RING, RACER, Randomisation(), rivals={"mass_spread": 0.0}) is None


def test_drones_collide_at_the_mean_of_their_sizes():
    small = dataclasses.replace(RACER, name="small", collision_distance=0.1)
    env = make_race_env(RING, 2, (RACER, small))
    rules = arrays(race_rules(RACER.agility, jnp.array([[0.3], [0.1]]), 0))
    for apart, hit in ((0.19, True), (0.21, False)):
        grid = start(2)._replace(
            position_w=jnp.array([[0.0, apart], [-9.0, -9.0], [3.0, 3.0]])[:, :, None].repeat(RACES, 2)
        )
        still = jnp.zeros((4, 2, RACES)).at[0].set(2 * 9.81 / RACER.agility - 1)
        _, outcome = env.step(env.begin(grid), still, rules)
        np.testing.assert_array_equal(outcome.collisions.drone, np.full((2, RACES), hit))


@pytest.mark.parametrize(
    ("fleet", "complaint"),
    [
        ((RACER, PAPER), "vehicles 'racer' and 'paper' cannot share a race: one is told something every 0.02 s"),
        ((RACER, HEAVY, RACER), "a race of 2 drones needs 2 vehicles, or one for all, not 3"),
    ],
)
def test_what_cannot_share_a_race_is_told(fleet, complaint):
    with pytest.raises(CruiseError, match=complaint):
        each_of(fleet, 2)


def straight(view):
    """In plain Python, told three numbers."""
    way = view.gates.position_w[view.next_gate] - view.position_w
    return 0.4 * way / np.linalg.norm(way)


straight.vehicle = TOLD


def test_pilots_of_every_kind_race_in_vehicles_of_every_kind(tmp_path):
    """A policy, a scripted pilot and one in plain Python, each told what its own vehicle is told."""
    team = ["racer-ring", "chaser", straight]
    match = make_match(RING, 3, team, 1, budget=600.0, vehicle=[RACER, HEAVY, TOLD])
    assert match.names == ("racer-ring (racer)", "chaser (heavy)", "straight (told)")
    rules = team_rules(match.team, 0.1, 0, (1,))
    flight = fly_races(match.env, match.team, rules, jax.random.key(0), 8, (1,))
    info = RaceInfo(RING, 1, [vehicle.name for vehicle in match.vehicles], 0.1, [pilot.name for pilot in match.team])
    (log,) = race_logs(flight, info)
    assert (log.vehicles.tolist(), log.vehicle) == (["racer", "heavy", "told"], "racer, heavy, told")
    log.save(tmp_path / "race.npz")
    again = load_race_log(tmp_path / "race.npz")
    assert [drone["pilot"] for drone in pack_race(again, "mixed")["drones"]] == list(match.names)
    assert log.action[:-1, 0, 3].all()  # the policy yaws
    assert not log.action[:, 2, 3].any()  # a number that its vehicle is not told
    way = log.gate_position[log.next_gate[0, 2]] - log.position_w[0, 2]
    np.testing.assert_allclose(log.action[0, 2, :3], 0.4 * way / np.linalg.norm(way), atol=1e-4)


@pytest.mark.parametrize(
    ("pilots", "vehicles", "complaint"),
    [
        (["chaser"], [RACER, HEAVY, RACER], "3 vehicles for 2 drones: give one for all, or at most one per drone"),
        (["racer-ring"], [RACER, TOLD], "pilot 'racer-ring' was made for vehicle 'racer', this race flies 'told'"),
    ],
)
def test_pilots_and_vehicles_that_do_not_go_together_are_told(pilots, vehicles, complaint):
    with pytest.raises(CruiseError, match=complaint):
        make_match(RING, 2, pilots, vehicle=vehicles)
