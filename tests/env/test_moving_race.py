"""Races whose gates move: everybody who looks at a race finds them where they are, and nobody pays where none moves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import cruise
from cruise.config import Gate, Motion, Randomisation, Sensing, Track
from cruise.env.race_env import make_race_env
from cruise.env.randomise import perturbation
from cruise.env.types import race_rules
from cruise.env.view import View
from cruise.errors import CruiseError
from cruise.limit.lap import find_limit
from cruise.pilots.scripted import SCRIPTED
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.grid import Start
from cruise.racing.motion import gates_at
from cruise.rollout import fly_from, team_rules
from cruise.storage.log_track import gates_of
from cruise.storage.race_log import EVENT_KINDS, load_race_log
from cruise.storage.recorder import RaceInfo, race_logs
from cruise.training.imitation import state_of
from tests.helpers import arrays

MOVING, PAPER = TRACKS["moving"], VEHICLES["paper"]
DT = PAPER.control_dt
RULES = arrays(race_rules(PAPER.agility, 0.0, 0))


def places(gates):
    return np.array([gate.position_w for gate in gates])


@pytest.fixture(scope="module")
def flown():
    """Every state of two races whose drones hover, and what every step did."""
    env = make_race_env(MOVING, 2, PAPER)

    def step(state, _):
        after, outcome = env.step(state, jnp.zeros((3, 2, 2)), RULES)
        return after, (state, outcome, env.observe(state))

    return env, *jax.jit(lambda key: jax.lax.scan(step, env.reset(key, (2,)), length=60)[1])(jax.random.key(4))


def test_a_race_has_its_gates_where_its_step_has_them(flown):
    env, states, _, observed = flown
    for k in (0, 7, 59):
        state = jax.tree.map(lambda leaf, k=k: leaf[k], states)
        now, course = gates_at(MOVING.gates, k * DT), env.course_of(state)
        for race in range(2):
            np.testing.assert_allclose(course.position_w[:, :, race].T, places(now), atol=2e-5)
            heading = np.exp(1j * np.array([gate.yaw for gate in now]))
            np.testing.assert_allclose(np.array([1, 1j]) @ np.asarray(course.normal_w[:, :, race]), heading, atol=2e-5)
        seen = View(course, env.dynamics, state).gate_w()
        np.testing.assert_allclose(seen, np.moveaxis(places(now)[np.array(state.next_gate)], 2, 0), atol=2e-5)
        again = env.observe(
            env.with_gates_at(state._replace(surroundings=env.reset(jax.random.key(0), (2,)).surroundings))
        )
        np.testing.assert_allclose(again, observed[k], atol=1e-4)  # from any race's gates, at this one's step


def test_progress_is_paid_towards_where_the_gate_is(flown):
    """What is paid on the way sums up to how much nearer a drone has come, however the gate moved meanwhile."""
    env, states, outcome, _ = flown
    paid, scale = np.asarray(outcome.components["prog"]).cumsum(axis=0), 0.45 * 2.5

    def to_go(k):
        state = jax.tree.map(lambda leaf: leaf[k], states)
        view = View(env.course_of(state), env.dynamics, state)
        return np.asarray(view.to_opening(view.position_w, 0.2))

    assert np.asarray(states.airborne[50]).all()
    assert np.abs(paid).max() > 0.1
    for k in (1, 20, 50):
        np.testing.assert_allclose(paid[k - 1], scale * (to_go(0) - to_go(k)), atol=1e-4)


def test_what_does_not_move_costs_nothing():
    env = make_race_env(TRACKS["ring"], 1, PAPER)
    state = env.reset(jax.random.key(0))
    assert env.course.motions is None
    assert (state.surroundings.gates, state.surroundings.rest) == (None, None)
    assert env.with_gates_at(state).surroundings is state.surroundings


def test_moved_gates_move_about_where_they_were_moved_to():
    shift = Randomisation(gate_shift=0.5, gate_turn=0.3)
    env = make_race_env(MOVING, 1, PAPER, perturb=perturbation(MOVING, PAPER, shift))
    state = jax.jit(env.reset, static_argnums=1)(jax.random.key(2), (3,))
    rest = np.asarray(state.surroundings.rest.position_w)
    assert 0.1 < np.abs(rest - places(MOVING.gates).T[..., None]).max() <= 0.5 + 1e-6
    later = env.with_gates_at(state._replace(step=jnp.array([0, 9, 33])))
    for race, k in enumerate((0, 9, 33)):
        moved = places(gates_at(MOVING.gates, k * DT)) - places(MOVING.gates)
        np.testing.assert_allclose(
            later.surroundings.gates.position_w[:, :, race] - rest[:, :, race], moved.T, atol=2e-5
        )


def test_a_look_shows_gates_where_they_were_when_it_was_taken():
    sensing = Sensing("range", sensor_range=99.0, sensor_rate=1 / DT, sensor_latency=0.3, fix_error=0.0)
    env = make_race_env(MOVING, 1, PAPER, perturb=perturbation(MOVING, PAPER, Randomisation(), sensing=sensing))

    def step(state, _):
        after, _ = env.step(state, jnp.zeros((3, 1)), RULES)
        return after, after

    states = jax.jit(lambda key: jax.lax.scan(step, env.reset(key), length=12)[1])(jax.random.key(0))
    believed = np.asarray(states.surroundings.sensed.gates.position_w)[11, :, :, 0].T
    np.testing.assert_allclose(believed, places(gates_at(MOVING.gates, 12 * DT - 0.3)), atol=2e-5)


SWEEPS = Track(
    "sweeps",
    (
        Gate((0.0, 0.0, 2.0), 0.0, 1.0, 1.0, motion=Motion(8.0, (-3.0, 0.0, 0.0))),
        Gate((9.0, 0.0, 2.0), 0.0, 1.0, 1.0),
    ),
    (-15.0, -15.0, 0.0),
    (15.0, 15.0, 9.0),
    leave_distance=20.0,
)


@pytest.fixture(scope="module")
def swept():
    """A log of two drones that wait where a gate sweeps over them: one in its opening, one where its frame comes by."""
    env = make_race_env(SWEEPS, 2, PAPER)
    at = jnp.array([[-1.5, -1.5], [0.0, 0.65], [2.0, 2.0]])[..., None]
    state = env.begin(Start(at, jnp.zeros((2, 1)), jnp.zeros(1, jnp.int32)))
    team = [SCRIPTED["hover"]] * 2
    flight = fly_from(env, team, team_rules(team, 0.25, 0, (1,)), state, jax.random.key(0), 20)
    return env, race_logs(flight, RaceInfo(SWEEPS, 1, "paper", 0.25, ["hover", "hover"]))[0]


def test_a_gate_that_sweeps_over_a_waiting_drone_is_passed_and_its_frame_strikes(swept):
    _, log = swept
    told = [
        (EVENT_KINDS[k], int(d), int(g))
        for k, d, g in zip(log.event_kind, log.event_drone, log.event_gate, strict=True)
    ]
    assert sorted(told, key=lambda event: event[1]) == [("crossing", 0, 0), ("collision_gate_frame", 1, 0)]
    # -3 sin(2 pi t / 8) = -1.5; between the two samples the gate is taken to go straight
    np.testing.assert_allclose(log.event_time, 8.0 / 12.0, atol=5e-3)


def test_logs_keep_how_gates_move_and_older_ones_have_none(swept, tmp_path):
    env, log = swept
    log.save(tmp_path / "race.npz")
    again = load_race_log(tmp_path / "race.npz")
    assert [gate.motion for gate in gates_of(again)] == [gate.motion for gate in SWEEPS.gates]
    np.testing.assert_allclose(places(gates_of(again)), places(SWEEPS.gates))
    with np.load(tmp_path / "race.npz") as file:
        np.savez(tmp_path / "old.npz", **{name: file[name] for name in file.files if name != "gate_motion"})
    assert not any(gate.motion for gate in gates_of(load_race_log(tmp_path / "old.npz")))
    course = env.course_of(state_of(env, log))  # every sample is a race of its own
    assert float(course.position_w[0, 0, 6]) == pytest.approx(gates_at(SWEEPS.gates, 0.6)[0].position_w[0], abs=1e-5)


def test_pilots_in_plain_python_see_gates_where_they_are():
    seen = []

    def watch(view):
        seen.append((view.time, view.gates.position_w.copy(), view.gates.yaw.copy(), view.gates.normal_w.copy()))
        return np.zeros(3)

    cruise.race(SWEEPS, 2, [watch, "hover"], laps=1)
    for time, position, yaw, normal in seen[:8]:
        now = gates_at(SWEEPS.gates, time)
        np.testing.assert_allclose(position, places(now), atol=2e-5)
        np.testing.assert_allclose(normal[:, 0], np.cos(yaw), atol=1e-6)


@pytest.mark.parametrize(
    "door", [lambda: find_limit(MOVING, VEHICLES["racer"]), lambda: cruise.race(MOVING, 2, ["se-ibr"])]
)
def test_who_needs_gates_that_stand_still_says_so(door):
    with pytest.raises(CruiseError, match=r"gates that stand still, and those of 'moving' move$"):
        door()
