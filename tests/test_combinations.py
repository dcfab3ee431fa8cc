"""Every vehicle, flown by every kind of pilot, through every door, on a track with one of everything."""

import dataclasses
import math

import jax
import numpy as np
import pytest

import cruise
from cruise.adapters.gymnasium_env import RaceEnv
from cruise.adapters.options import RaceOptions, choose
from cruise.env.race_env import make_race_env
from cruise.evaluation import matches
from cruise.pilots.foreign import wrap
from cruise.pilots.network import NetworkShape
from cruise.pilots.neural import NeuralPilot
from cruise.pilots.scripted import Chaser, Hover
from cruise.pilots.se_ibr import SeIbrPilot, Style
from cruise.pilots.se_ibr.options import Algorithm
from cruise.presets import TRACKS, curriculum_of, training_config
from cruise.racing.events import COLLISION_KINDS
from cruise.storage.race_log import EventKind
from cruise.vehicles import VEHICLES, load_vehicle
from tests.racing.obstacles import distance, pole_in_the_way, wall_in_the_way, with_solids
from tests.storage.policies import random_network

SECONDS = 0.6
BRIEF = Algorithm(horizon=4, rounds=1, iterations=3)
FILE = """name = "courier"
base = "racer"
mass_kg = 0.9
control = "velocity"
"""


def one_of_everything():
    """The ring with a tilted gate, a round one, a pole and a wall."""
    ring = TRACKS["ring"]
    first, second, *others = ring.gates
    gates = (dataclasses.replace(first, roll=0.3, pitch=0.2), dataclasses.replace(second, shape="round"), *others)
    track = dataclasses.replace(ring, name="everything", gates=gates, laps=1)
    return with_solids(track, pole_in_the_way(track, 1), wall_in_the_way(track, 2))


TRACK = one_of_everything()
CHOICES = (*VEHICLES, "courier.toml")


@pytest.fixture(scope="module", params=CHOICES)
def choice(request, tmp_path_factory):
    """As users name a vehicle: built in, or by a file."""
    if request.param in VEHICLES:
        return request.param
    path = tmp_path_factory.mktemp("vehicles") / request.param
    path.write_text(FILE)
    return path


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(matches, "TIME_LIMIT", SECONDS)
    monkeypatch.setattr(matches, "SLOWEST", math.inf)


def network_for(vehicle, drones):
    """That fits the vehicle in a race of so many."""
    env = make_race_env(TRACK, drones, load_vehicle(vehicle), training_config(vehicle, drones).observation)
    sees = jax.eval_shape(env.observe, jax.eval_shape(env.reset, jax.random.key(0))).shape[0]
    return random_network(NetworkShape(sees, len(vehicle.action.numbers), (8, 8)))


def pilots_of(vehicle):
    """One of each kind: networks, scripted ones, the planner, Python."""
    size = len(vehicle.action.numbers)

    def in_python(view):
        return np.full(size, 0.1)

    in_python.vehicle = vehicle
    planner = SeIbrPilot(Style(2.0, 1.0), algorithm=BRIEF)
    versatile = [pilot.for_vehicle(vehicle) for pilot in (Chaser(), Hover(), planner)]
    observation = training_config(vehicle, 5).observation
    neural = NeuralPilot(network_for(vehicle, 5), observation, 5, vehicle.agility, "network", vehicle)
    return [neural, *versatile, wrap(in_python)]


def test_through_every_door(choice):
    vehicle = load_vehicle(choice)
    pilots = pilots_of(vehicle)
    races_are_sound_and_the_same_again(choice, pilots)
    the_learner_sees_what_the_environment_shows(choice, vehicle, pilots)
    every_agent_sees_what_the_environment_shows(choice, vehicle)


def races_are_sound_and_the_same_again(choice, pilots):
    first, again = (cruise.race(TRACK, 5, pilots, seed=3, vehicle=choice, randomise=0.5) for _ in range(2))
    for field in dataclasses.fields(first):
        value, other = (np.asarray(getattr(log, field.name)) for log in (first, again))
        np.testing.assert_array_equal(value, other, err_msg=field.name)
        assert value.dtype.kind != "f" or np.isfinite(value).all(), field.name
    assert first.time[-1] > SECONDS / 2
    starts_inside(first.position_w[0])
    assert not np.isin(first.event_kind[first.event_time == 0], COLLISION_KINDS).any()
    assert set(first.pilots) == {pilot.name for pilot in pilots}
    assert not (first.event_kind == EventKind.FINISH).any()


def starts_inside(position_w):
    """Drones [N, 3] are on the track, and in no solid."""
    assert (position_w > TRACK.bounds_low).all()
    assert (position_w < TRACK.bounds_high).all()
    assert all((distance(solid, position_w) > 0).all() for solid in TRACK.obstacles)


def the_learner_sees_what_the_environment_shows(choice, vehicle, pilots):
    """Against two of the pilots, others with every vehicle; scripted ones are put into the vehicle by the adapter."""
    first = CHOICES.index(str(getattr(choice, "name", choice)))
    kinds = [pilots[0], Chaser(), Hover(), SeIbrPilot(Style(2.0, 1.0), algorithm=BRIEF), pilots[4]]
    kinds[0] = dataclasses.replace(kinds[0], drones=3, params=network_for(vehicle, 3))
    env = RaceEnv(track=TRACK, vehicle=choice, randomise=0, opponents=[kinds[first % 5], kinds[(first + 2) % 5]])
    seen = [env.reset(seed=2)[0]]
    shown = make_race_env(TRACK, 3, load_vehicle(choice), env._races.choices.observation)
    observe = jax.jit(shown.observe)
    for _ in range(3):
        np.testing.assert_allclose(seen[-1], observe(env._races.state)[:, 0, 0], atol=1e-5)
        observation, reward, *_, info = env.step(np.full(env.action_space.shape, 0.1, np.float32))
        seen.append(observation)
        assert np.isfinite(reward)
        assert observation in env.observation_space
        assert {name for name in info if name.startswith("collision_")} == {
            f"collision_{k.hit}" for k in COLLISION_KINDS
        }
    starts_inside(np.asarray(env._races.state.drones.position_w[..., 0]).T)
    assert not np.array_equal(seen[0], seen[-1])


def every_agent_sees_what_the_environment_shows(choice, vehicle):
    env = cruise.parallel_env(track=TRACK, vehicle=choice, drones=2, randomise=0)
    told, _ = env.reset(seed=2)
    observation = env._races.choices.observation
    assert observation == training_config(vehicle, 2).observation
    observe = jax.jit(make_race_env(TRACK, 2, load_vehicle(choice), observation).observe)
    for _ in range(2):
        shown = observe(env._races.state)[..., 0]
        for drone, agent in enumerate(env.agents):
            np.testing.assert_allclose(told[agent], shown[:, drone], atol=1e-5)
        told, rewards, *_ = env.step({agent: np.zeros(env.action_space(agent).shape) for agent in env.agents})
        assert np.isfinite(list(rewards.values())).all()


def test_adapters_are_as_their_vehicle_is_trained():
    """Observation, reward and stage are those of the vehicle's own recipe."""
    for choice in VEHICLES:
        for drones in (1, 4):
            chosen = choose(RaceOptions("ring", drones, vehicle=choice, stage=3), everybody_learns=True)
            usual = training_config(choice, drones)
            assert chosen.stage == curriculum_of(VEHICLES[choice])[2]
            assert (chosen.observation, chosen.weights) == (usual.observation, usual.reward)
            assert (chosen.randomisation, chosen.limit) == (usual.randomisation, usual.episode_steps)
            assert chosen.collision_distance == (usual.collision_distance,)
