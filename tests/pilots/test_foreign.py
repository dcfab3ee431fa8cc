"""Pilots in plain Python: they fly as pilots in JAX do, see what is there, and are told clearly what is wrong."""

import asyncio
import contextlib
import dataclasses
import sys
import time
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cruise.env.race_env import make_race_env
from cruise.errors import CruiseError
from cruise.pilots import python_pilot
from cruise.pilots.foreign import ForeignPilot, wrap
from cruise.pilots.neural import NeuralPilot
from cruise.pilots.scripted import SCRIPTED, Chaser
from cruise.pilots.view import gates_of
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.course import make_course
from cruise.rollout import fly, team_rules
from tests.pilots.test_neural import loud_params

DRONES, RACES, STEPS = 3, 2, 40
ENV = make_race_env(TRACKS["ring"], DRONES, VEHICLES["paper"])
PARAMS = loud_params(drones=DRONES)


def flown(team, steps=STEPS):
    rules = team_rules(team, 0.25, 0, (RACES,))
    return fly(ENV, team, rules, jax.random.key(3), steps, (RACES,))


def network(observation):
    """The policy's action for observations [..., O], in the gate's frame."""
    x = observation
    layers = PARAMS.actor.layers
    for i, layer in enumerate(layers):
        x = x @ np.asarray(layer.weight).T + np.asarray(layer.bias)
        x = np.tanh(x) if i < len(layers) - 1 else x
    return x


class SeesObservation:
    observation = "extended"

    def act(self, view):
        return network(view.observation)


class ManyAtOnce:
    observation = "extended"

    def act_batch(self, view):
        assert view.observation.shape[0] == len(view.drone) == DRONES * RACES
        return network(view.observation)


def as_a_function(view):
    return network(view.observation).tolist()


as_a_function.observation = "extended"


@pytest.fixture(scope="module")
def in_jax():
    return flown([NeuralPilot(PARAMS, "extended", DRONES, 7.5, "test")] * DRONES)


@pytest.mark.parametrize("thing", [SeesObservation, ManyAtOnce, as_a_function, SeesObservation()])
def test_a_policy_in_python_flies_the_same_race(thing, in_jax):
    flight = flown([wrap(thing)] * DRONES)
    length = min(len(flight.position_w), len(in_jax.position_w))
    assert length > 20
    np.testing.assert_allclose(flight.position_w[:length], in_jax.position_w[:length], atol=2e-3)
    np.testing.assert_allclose(flight.action[:20], in_jax.action[:20], atol=2e-3)


class HoversInPython:
    """`cruise.pilots.scripted.Hover`, which remembers where it started and speaks of the world."""

    def __init__(self):
        self.start = None

    def act(self, view):
        self.start = view.position_w if self.start is None else self.start
        return np.clip(0.5 * (0.3 * (self.start - view.position_w) - view.velocity_w), -1.0, 1.0)


def test_every_drone_of_every_race_has_a_memory_of_its_own():
    hover = SCRIPTED["hover"]
    in_python, compiled = (flown([pilot, hover, pilot], steps=20) for pilot in (wrap(HoversInPython), hover))
    np.testing.assert_allclose(in_python.position_w, compiled.position_w, atol=1e-5)
    np.testing.assert_allclose(in_python.action, compiled.action, atol=1e-5)


class Witness:
    """Remembers what it saw; one object per drone and race."""

    made: list = []  # noqa: RUF012

    def __init__(self):
        self.views = []
        Witness.made.append(self)

    def act(self, view):
        self.views.append(view)
        return [0.0, 0.0, 0.1 * view.drone]


def cos_sin(yaw, pitch):
    """The body's forward axis in the world."""
    return [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]


def test_what_a_pilot_sees_beside_others():
    Witness.made.clear()
    witness = wrap(Witness)
    flight = flown([witness, SCRIPTED["chaser"], witness], steps=12)
    assert len(Witness.made) == 2 * RACES
    for flown_by in Witness.made:
        first = flown_by.views[0]
        drone = first.drone
        race = next(e for e in range(RACES) if np.allclose(first.position_w, flight.position_w[0, :, drone, e]))
        around = [(drone + 1) % DRONES, (drone + 2) % DRONES]
        for k, view in enumerate(flown_by.views):
            assert view.drone == drone
            assert view.time == pytest.approx(k * 0.1)
            forward, left, up = view.rotation_wb.T
            np.testing.assert_allclose(np.cross(forward, left), up, atol=1e-6)
            _, pitch, yaw = view.euler
            np.testing.assert_allclose(forward, cos_sin(yaw, pitch), atol=1e-6)
            for name in ("position_w", "velocity_w", "euler"):
                np.testing.assert_allclose(getattr(view, name), getattr(flight, name)[k, :, drone, race], atol=1e-6)
            np.testing.assert_allclose(view.others_position_w, flight.position_w[k][:, around, race].T, atol=1e-6)
            np.testing.assert_allclose(view.others_velocity_w, flight.velocity_w[k][:, around, race].T, atol=1e-6)
            assert view.others_airborne.tolist() == flight.airborne[k][around, race].tolist()
            assert view.next_gate == flight.next_gate[k, drone, race]
            assert view.observation is None
            assert (view.control_dt, view.agility) == (0.1, 7.5)
        np.testing.assert_allclose(flight.action[:, 2, drone, race], 0.1 * drone)
    gates = Witness.made[0].views[0].gates
    for g, gate in enumerate(TRACKS["ring"].gates):
        np.testing.assert_allclose(gates.position_w[g], gate.position_w, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(gates.normal_w[g], [np.cos(gate.yaw), np.sin(gate.yaw), 0], atol=1e-6)
        np.testing.assert_allclose(np.exp(1j * gates.yaw[g]), np.exp(1j * gate.yaw), atol=1e-6)
        assert (gates.width[g], gates.height[g]) == (2.0, 2.0)


def test_body_rates_are_those_of_the_body():
    """Euler's equations at small angles: roll's rate is the difference of two rolls."""
    Witness.made.clear()

    class Turns(Witness):
        def act(self, view):
            super().act(view)
            return [0.0, 0.5, 0.2]

    flown([wrap(Turns)] * DRONES, steps=6)
    for one in Witness.made:
        for before, after in zip(one.views, one.views[1:], strict=False):
            np.testing.assert_allclose(after.euler - before.euler, 0.1 * before.angular_velocity_b, atol=2e-3)


def test_who_is_out_is_not_asked_again():
    Witness.made.clear()

    class Sinks(Witness):
        def act(self, view):
            super().act(view)
            assert view.airborne
            return [0.0, 0.0, -1.0]

    flight = flown([wrap(Sinks)] * DRONES, steps=100)
    asked = [len(one.views) for one in Witness.made]
    assert sum(asked) == flight.airborne[: len(flight.action)].sum()
    assert max(asked) < 60


class Sleeps:
    def act(self, view):
        time.sleep(0.03)


def test_constructors_have_time(monkeypatch):
    """Loading a model takes time; the budget is that of actions."""
    clock = [0.0]

    class Wakes:
        def __init__(self):
            clock[0] += 100.0

        def act(self, view):
            clock[0] += 1.0
            return np.zeros(3)

    monkeypatch.setattr(python_pilot, "time", SimpleNamespace(perf_counter=lambda: clock[0]))
    assert len(flown([wrap(Wakes, budget=30.0)] * DRONES, steps=1).action) == 1
    monkeypatch.setattr(python_pilot, "cut_off", lambda seconds: contextlib.nullcontext())
    with pytest.raises(CruiseError, match="took 1000 ms, more than its budget of 500 ms"):
        flown([wrap(Wakes, budget=0.5)] * DRONES, steps=1)


class Endless:
    def act(self, view):
        while True:
            pass


class FailsLater:
    def act(self, view):
        if view.time > 0.15:
            raise KeyError("no such\n gate")
        return np.zeros(3)


class Cancels:
    def act(self, view):
        raise asyncio.CancelledError


class Batch:
    def __init__(self, answer):
        self.answer = answer

    def act_batch(self, view):
        return self.answer(view)


def one_nan(view):
    actions = np.zeros((len(view.drone), 3))
    actions[-1, 1] = np.nan
    return actions


WANTED = "expected 3 finite numbers in [-1, 1]"
BAD = {
    "two numbers": (lambda view: [0.0, 1.0], f"drone 1, 0.00 s into the race: gave an array of shape [2], {WANTED}"),
    "nan": (lambda view: [0.0, np.nan, 1.0], f"gave [0.0, nan, 1.0], {WANTED}"),
    "infinite": (lambda view: np.full(3, np.inf), f"gave [inf, inf, inf], {WANTED}"),
    "nothing": (lambda view: None, "gave an array of shape [], expected"),
    "a word": (lambda view: "left", f"gave str 'left', {WANTED}"),
    "a dictionary": (lambda view: {"x": 1}, f"gave dict {{'x': 1}}, {WANTED}"),
    "ragged": (lambda view: [[0.0], [1.0, 2.0]], "gave list [[0.0], [1.0, 2.0]], expected"),
    "an exception": (FailsLater, "drone 1, 0.20 s into the race: raised KeyError: 'no such\\n gate' ("),
    "where it was raised": (FailsLater, "test_foreign.py, line "),
    "leaves": (lambda view: sys.exit(), "drone 1, 0.00 s into the race: raised SystemExit ("),
    "leaves with a word": (lambda view: sys.exit("enough"), "raised SystemExit: enough ("),
    "is cancelled": (Cancels, "raised CancelledError ("),
    "slow": (Sleeps, "its budget of 20 ms; make it faster, or give it more (--budget-ms)"),
    "endless": (Endless, "was not done within its budget of 20 ms"),
    "too few rows": (Batch(lambda view: np.zeros((1, 3))), "gave an array of shape [1, 3], expected shape [6, 3]"),
    "nan in a row": (Batch(one_nan), f"drone 3, 0.00 s into the race: gave [0.0, nan, 0.0], {WANTED}"),
    "no method": (Batch(lambda view: view.speed), "raised AttributeError: 'View' object has no attribute 'speed'"),
}


@pytest.mark.parametrize("case", BAD)
def test_nonsense_ends_the_race_with_one_line(case):
    thing, message = BAD[case]
    pilot = wrap(thing, name="mine", budget=0.02 if case in ("slow", "endless") else 30.0)
    with pytest.raises(CruiseError) as error:
        flown([pilot] * DRONES, steps=4)
    text = str(error.value)
    assert text.startswith("pilot 'mine', drone ")
    assert message in text
    assert "\n" not in text


def test_what_is_no_pilot():
    class NoMethod:
        pass

    class NeedsMore:
        def __init__(self, model):
            pass

        def act(self, view):
            return model

    class Sees:
        observation = "camera"

        def act(self, view):
            return view

    class Strong(Sees):
        observation = None
        agility = -1

    for thing, message in (
        (NoMethod, "class NoMethod has no method act: act(view) gives its action"),
        (7, "pilot 'int' is of type int: expected a function or a class"),
        (Sees, "unknown observation 'camera'; there are extended, paper"),
        (Strong, "agility must be a number above 0, got -1"),
    ):
        with pytest.raises(CruiseError) as error:
            wrap(thing)
        assert message in str(error.value)
    with pytest.raises(CruiseError, match="budget of a pilot must be above 0, got 0 s"):
        wrap(Sleeps, budget=0.0)

    class Leaves(Sleeps):
        def __init__(self):
            sys.exit(3)

    with pytest.raises(CruiseError, match=r"pilot 'Leaves' could not be made: SystemExit: 3 \("):
        flown([wrap(Leaves)] * DRONES, steps=1)
    with pytest.raises(CruiseError, match=r"pilot 'NeedsMore' could not be made: TypeError: .*takes no arguments"):
        flown([wrap(NeedsMore)] * DRONES, steps=1)


def test_names_and_attributes():
    class Named:
        name, agility = "ace", 3

        def __call__(self, view):
            return view

    pilot = wrap(Named, name="file.py:Named")
    assert isinstance(pilot, ForeignPilot)
    assert (pilot.name, pilot.agility, pilot.style, pilot.vehicle) == ("ace", 3.0, "object", "paper")
    assert wrap(as_a_function, name="file.py:function").name == "file.py:function"
    chaser = SCRIPTED["chaser"]
    assert wrap(chaser) is chaser
    assert wrap(Chaser) == Chaser()
    with pytest.raises(CruiseError, match="'ace' is plain Python: it cannot fly inside a compiled program"):
        jax.eval_shape(lambda key: pilot.init(ENV, (0,), ENV.reset(key)), jax.random.key(0))


def test_pilots_are_told_how_gates_lean():
    ring = TRACKS["ring"]
    leaning = dataclasses.replace(ring.gates[1], pitch=0.4, roll=-0.3, shape="round")
    track = dataclasses.replace(ring, gates=(ring.gates[0], leaning, *ring.gates[2:]))
    seen = gates_of(make_course(track), track.gates)
    axes = Rotation.from_euler("ZYX", [leaning.yaw, leaning.pitch, leaning.roll]).as_matrix()
    np.testing.assert_allclose(seen.normal_w[1], axes[:, 0], atol=1e-6)
    assert (seen.pitch[1], seen.roll[1], seen.is_round.tolist()) == (0.4, -0.3, [False, True, False, False, False])
    np.testing.assert_allclose(seen.normal_w[0], [np.cos(seen.yaw[0]), np.sin(seen.yaw[0]), 0.0], atol=1e-12)
