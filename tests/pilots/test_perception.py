"""Whatever its kind, a pilot sees the race as its drones measure it: wrong by as much, and by the same for one seed."""

import equinox as eqx
import jax
import numpy as np
import pytest

from cruise.config import Randomisation, Sensing
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.randomise import NOISE, perturbation
from cruise.export.files import Exporter
from cruise.pilots.foreign import wrap
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.field import rows
from cruise.rollout import fly, team_rules
from cruise.storage.onnx_pilot import load_onnx_pilot
from tests.export.conftest import policy_of

SIGMA, RACES, STEPS, SCALE = 0.1, 64, 3, 50.0
RING, EIGHT, PAPER = TRACKS["ring"], TRACKS["figure-eight"], VEHICLES["paper"]


def env_of(track, drones: int) -> RaceEnv:
    wrong = Randomisation(position_error=SIGMA)
    return make_race_env(track, drones, PAPER, perturb=perturbation(track, PAPER, wrong))


class InJax(eqx.Module):
    """Its action tells where it believes to be."""

    name: str = "in-jax"
    agility: float = 0.1
    vehicle: str = "paper"

    def init(self, env, drones, state):
        return rows(state.drones.position_w, drones, axis=1)  # where it believes to start

    def act(self, env, drones, memory, state, key):
        return memory, rows(state.drones.position_w, drones, axis=1) / SCALE


class Remembers(InJax):
    """Its action tells where it believed to start."""

    def act(self, env, drones, memory, state, key):
        return memory, memory / SCALE


def as_a_function(view):
    return view.position_w / SCALE


class AsAnObject:
    agility = 0.1

    def act(self, view):
        return view.position_w / SCALE


class ManyAtOnce:
    agility = 0.1

    def act_batch(self, view):
        return view.position_w / SCALE


class SeesOthers:
    """Tells where the drone before it believes to be."""

    agility = 0.1

    def act(self, view):
        return view.others_position_w[-1] / SCALE


as_a_function.agility = 0.1
KINDS = {"jax": InJax(), "function": wrap(as_a_function), "object": wrap(AsAnObject), "batch": wrap(ManyAtOnce)}
KINDS |= {"others": wrap(SeesOthers), "memory": Remembers()}


@pytest.fixture(scope="module")
def flights():
    """The same races with one kind of pilot after the other in drone 2, those of drone 1 being JAX's."""
    env, found = env_of(RING, 2), {}
    for kind, pilot in KINDS.items():
        team = [KINDS["jax"], pilot]
        rules = team_rules(team, 0.25, 0, (RACES,))
        found[kind] = fly(env, team, rules, jax.random.key(3), STEPS, (RACES,))
    return found


def believed(flight, drone=1):
    return flight.action[:, :, drone] * SCALE


@pytest.mark.parametrize("kind", ["jax", "function", "object", "batch"])
def test_every_kind_of_pilot_is_wrong_by_as_much(flights, kind):
    flight = flights[kind]
    error = believed(flight) - flight.position_w[:-1, :, 1]
    assert error.std() == pytest.approx(SIGMA * np.sqrt(1 + NOISE**2), rel=0.1)
    bias = error.mean(axis=0)
    assert (error - bias).std() == pytest.approx(SIGMA * NOISE * np.sqrt(1 - 1 / STEPS), rel=0.1)


@pytest.mark.parametrize("kind", ["function", "object", "batch"])
def test_every_kind_of_pilot_sees_the_same(flights, kind):
    np.testing.assert_allclose(believed(flights[kind]), believed(flights["jax"]), atol=1e-4)


def test_others_are_seen_where_they_believe_to_be(flights):
    flight = flights["others"]
    np.testing.assert_allclose(believed(flight, 1), believed(flight, 0), atol=1e-4)


def test_what_a_pilot_remembers_of_the_start_is_measured_too(flights):
    np.testing.assert_allclose(believed(flights["memory"])[0], believed(flights["jax"])[0], atol=1e-4)


class GateInJax(InJax):
    """Its action tells where it believes the first gate to be."""

    def act(self, env, drones, memory, state, key):
        return memory, rows(env.course_of(state).position_w[:, 0], drones, axis=1) / SCALE


class GateInPython:
    """So does this one's."""

    agility = 0.1

    def act(self, view):
        return view.gates.position_w[0] / SCALE


class GatesAtOnce(GateInPython):
    act = None

    def act_batch(self, view):
        return view.gates.position_w[:, 0] / SCALE


BY_SIGHT = perturbation(EIGHT, PAPER, Randomisation(gate_shift=1.0), sensing=Sensing("range", sensor_range=9.0))


def test_pilots_of_every_kind_believe_in_the_same_gates():
    """Seen by some drones and not by others, in the same races."""
    env = make_race_env(EIGHT, 2, PAPER, perturb=BY_SIGHT)
    pilots = (GateInJax(), wrap(GateInPython), wrap(GatesAtOnce))
    flights = []
    for pilot in pilots:
        rules = team_rules([pilot] * 2, 0.0, 0, (RACES,))
        flights.append(fly(env, [pilot] * 2, rules, jax.random.key(3), STEPS, (RACES,)))
    first, *others = (flight.action * SCALE for flight in flights)
    for other in others:
        np.testing.assert_allclose(other, first, atol=1e-4)
    true, mapped = flights[0].moved.position_w[:, 0][:, None], np.array(EIGHT.gates[0].position_w)[:, None, None]
    knows, knows_not = (np.abs(first[-1] - where).max(axis=0) < 1e-4 for where in (true, mapped))
    assert (knows ^ knows_not).all()
    assert 0 < knows.mean() < 1


@pytest.mark.parametrize("interface", ["state", "observation"])
def test_an_exported_policy_sees_what_the_policy_sees(interface, tmp_path):
    policy = policy_of("alone")
    path = Exporter.of(policy, EIGHT).onnx(tmp_path / "policy.onnx", interface).path
    by_sight = make_race_env(EIGHT, 1, PAPER, perturb=BY_SIGHT)
    for env in (by_sight, env_of(EIGHT, 1)):
        actions = []
        for pilot in (policy.pilot(), load_onnx_pilot(path, 10.0)):
            rules = team_rules([pilot], 0.25, 0, (RACES,))
            actions.append(fly(env, [pilot], rules, jax.random.key(3), STEPS, (RACES,)).action)
        np.testing.assert_allclose(*actions, atol=1e-3)
    exact = make_race_env(EIGHT, 1, PAPER)
    rules = team_rules([policy.pilot()], 0.25, 0, (RACES,))
    nominal = fly(exact, [policy.pilot()], rules, jax.random.key(3), STEPS, (RACES,)).action
    assert np.abs(actions[0] - nominal).max() > 0.01
