"""What drones know by sight: geometry by hand, time by recomputation, and every pilot of it the same."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import EXACT, Randomisation, Sensing
from cruise.env.draw_sensing import sensors_of
from cruise.env.race_env import make_race_env
from cruise.env.randomise import perturbation
from cruise.env.surroundings import as_known_by, perceive
from cruise.env.types import race_rules
from cruise.env.view import View
from cruise.errors import CruiseError
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.grid import Start
from tests.helpers import arrays, leaves

RING, RACER = TRACKS["ring"], VEHICLES["racer"]
DRONES, RACES, STEPS = 3, 4, 40
RULES = arrays(race_rules(RACER.agility, 0.0, 0))
SHIFT = Randomisation(gate_shift=0.5, gate_turn=0.2)
CAMERA = Sensing("camera", velocity_bias=0.3, sensor_latency=0.06, fix_error=0.0)
SENSINGS = {
    "camera": CAMERA,
    "near": Sensing("range", sensor_range=6.0, sensor_rate=50.0, sensor_latency=0.0, fix_error=0.0, velocity_bias=0.3),
    "radio": Sensing("range", sensor_range=0.5, opponents_by="radio", radio_delay=0.1, fix_error=0.0),
}


def env_of(sensing, randomisation=SHIFT):
    return make_race_env(RING, DRONES, RACER, "body", perturb=perturbation(RING, RACER, randomisation, sensing=sensing))


@pytest.fixture(scope="module", params=SENSINGS)
def flown(request):
    """Every state of some races whose drones tumble forward, each its own way."""
    sensing = SENSINGS[request.param]
    env = env_of(sensing)
    push = jnp.linspace(0.0, 0.5, DRONES * RACES).reshape(DRONES, RACES)
    action = jnp.stack([0.2 + push, 0.1 * push, push, 0.3 - push])

    def step(state, _):
        after, _ = env.step(state, action, RULES)
        return after, (state, perceive(state), env.dynamics.rotation(state.drones))

    def fly(key):
        return jax.lax.scan(step, env.reset(key, (RACES,)), length=STEPS)[1]

    return sensing, env, *jax.jit(fly)(jax.random.key(1))


def at(tree, step):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf)[step], tree)


def visible(sensing, rotation, origin, points):
    """[...] by spherical geometry of one drone: R_WB [3, 3], origin [3], points [3, ...]."""
    offset = np.einsum("wb,w...->b...", rotation, points - origin.reshape(3, *(1,) * (points.ndim - 1)))
    near = np.linalg.norm(offset, axis=0) <= sensing.sensor_range
    if sensing.sensing == "range":
        return near
    up = np.arctan2(offset[2], offset[0]) - sensing.camera_tilt  # about the left axis, upwards
    depth = np.hypot(offset[0], offset[2]) * np.cos(up)
    aside = np.abs(np.arctan2(offset[1], depth)) <= sensing.camera_width / 2
    return near & (np.abs(up) <= sensing.camera_height / 2) & aside & (depth > 0)


def recomputed(sensing, states, rotations):
    """By step, from the truth alone: which gates a drone has seen by then, and since when its place is known."""
    dt = RACER.control_dt
    latency, period = round(sensing.sensor_latency / dt), max(1, round(1 / (sensing.sensor_rate * dt)))
    gates = np.asarray(states.surroundings.gates.position_w)
    position = np.asarray(states.drones.body.position_w)
    for step in range(STEPS):
        exposed = step - latency if step >= latency and (step - latency) % period == 0 else None
        exposed = 0 if step == 0 else exposed
        seen = np.zeros((gates.shape[2], DRONES, RACES), bool)
        if exposed is not None:
            for drone in range(DRONES):
                for race in range(RACES):
                    turn = np.asarray(rotations)[exposed, :, :, drone, race]
                    seen[:, drone, race] = visible(
                        sensing, turn, position[exposed, :, drone, race], gates[exposed, :, :, race]
                    )
        yield step, exposed, seen


def test_a_gate_is_where_the_map_has_it_until_it_was_seen_and_a_sighting_tells_the_drone_its_place(flown):
    sensing, _env, states, seen_as, rotations = flown
    dt, mapped = RACER.control_dt, np.array([gate.position_w for gate in RING.gates]).T[:, :, None, None]
    velocity = np.asarray(states.drones.body.velocity_w)
    sensor = states.surroundings.sensed.sensor
    wrong = np.asarray(sensor.bias) + np.asarray(sensor.scale) * velocity
    truth, believed = (
        np.asarray(states.surroundings.gates.position_w),
        np.asarray(seen_as.surroundings.gates.position_w),
    )
    error = np.asarray(seen_as.drones.body.position_w) - np.asarray(states.drones.body.position_w)
    known = np.zeros(believed.shape[2:], bool)
    expected = np.zeros_like(error[0])
    last = [0]
    for step, exposed, seen in recomputed(sensing, states, rotations):
        known |= seen
        expected = expected + (dt * wrong[step] if step else 0.0)
        if exposed is not None:
            since = dt * wrong[exposed + 1 : step + 1].sum(axis=0)
            expected = np.where(seen.any(axis=0), since, expected)
            last.append(step)
        where = np.where(known, truth[step][:, :, None], mapped)
        np.testing.assert_allclose(believed[step], where, atol=1e-5)
        np.testing.assert_allclose(error[step], expected, atol=2e-5)
    assert known.mean() < 1
    assert known.any() == (sensing.opponents_by == "sight")
    np.testing.assert_allclose(np.asarray(seen_as.drones.body.velocity_w) - velocity, wrong, atol=1e-5)
    assert 0.05 < np.abs(np.asarray(sensor.bias)).max() <= sensing.velocity_bias


def test_opponents_are_known_in_sight_or_by_radio_alone(flown):
    sensing, env, states, seen_as, _ = flown
    dt = RACER.control_dt
    position, velocity = (np.asarray(getattr(states.drones.body, name)) for name in ("position_w", "velocity_w"))
    estimate = np.asarray(seen_as.drones.body.position_w)
    known = jax.tree.map(np.asarray, seen_as.opponents)
    late = round(sensing.radio_delay / dt)
    shares = []
    for step in range(STEPS // 2, STEPS):
        for drone in range(DRONES):
            for k in range(1, DRONES):
                other = (drone + k) % DRONES
                present = known.present[step, k - 1, drone]
                shares.append(present)
                if sensing.opponents_by == "radio":
                    sent = step - late
                    told = estimate[sent, :, other] + late * dt * velocity[sent, :, other]
                    away = np.linalg.norm(position[step, :, other] - position[step, :, drone], axis=0) > 0.7
                    np.testing.assert_array_equal(present[away], np.asarray(states.out)[sent, other][away] == 0)
                    np.testing.assert_allclose(
                        known.position_w[step, :, k - 1, drone][:, away], told[:, away], atol=1e-4
                    )
                else:
                    offset = known.position_w[step, :, k - 1, drone] - estimate[step, :, drone]
                    true = position[step, :, other] - position[step, :, drone]
                    flown_on = 0.5 if sensing.sensor_latency else 1e-4  # since the look, by steady velocity
                    np.testing.assert_allclose(offset[:, present], true[:, present], atol=flown_on)
    shares = np.array(shares)
    assert shares.any()
    assert sensing.sensing != "camera" or not shares.all()
    view = View(env.course_of(seen_as), env.dynamics, at(seen_as, STEPS - 1))
    there = np.asarray(view.nearest(1).present) | np.asarray(view.nearest(2).present)
    np.testing.assert_array_equal(there, known.present[STEPS - 1].any(axis=0))


def test_who_plans_for_all_is_shown_what_its_own_drones_know(flown):
    *_, seen_as, _ = flown
    last = at(seen_as, STEPS - 1)
    mine = as_known_by(last, (1,))
    np.testing.assert_array_equal(mine.drones.position_w[:, 1], last.drones.position_w[:, 1])
    np.testing.assert_array_equal(mine.drones.position_w[:, 0], last.opponents.position_w[:, 1, 1])
    np.testing.assert_array_equal(mine.airborne[2], last.opponents.present[0, 1])
    assert as_known_by(last, (0, 1, 2)).drones is last.drones


def test_exact_sensing_leaves_nothing_in_the_program():
    assert perturbation(RING, RACER, Randomisation(), sensing=EXACT) is None
    state = jax.jit(env_of(EXACT).reset, static_argnums=1)(jax.random.key(0), (2,))
    assert state.surroundings.sensed is None
    assert perceive(state) is state
    moved = jax.jit(env_of(CAMERA).reset, static_argnums=1)(jax.random.key(0), (2,))
    for a, b in zip(leaves(state.surroundings.gates), leaves(moved.surroundings.gates), strict=True):
        np.testing.assert_array_equal(a, b)  # sensors are drawn by a key of their own


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"sensor_range": 0.0}, "sensor_range must be above 0, not 0.0"),
        ({"sensor_rate": float("inf")}, "sensor_rate must be above 0, not inf"),
        ({"sensor_latency": 1.5}, "sensor_latency must be from 0 to 1 s, not 1.5"),
        ({"radio_delay": float("nan")}, "radio_delay must be from 0 to 1 s, not nan"),
        ({"camera_width": 3.2}, "camera_width must be between 0 and 3.14 rad, not 3.2"),
        ({"camera_tilt": -2.0}, "camera_tilt must be from -1.57 to 1.57 rad, not -2.0"),
        ({"velocity_bias": -0.1}, "velocity_bias must be 0 or more, not -0.1"),
    ],
)
def test_numbers_that_make_no_sense_are_told(change, complaint):
    with pytest.raises(CruiseError) as error:
        sensors_of(dataclasses.replace(CAMERA, **change), 0.02)
    assert str(error.value) == complaint


def test_a_pole_is_where_the_map_has_it_until_it_was_seen():
    """Races that begin half a metre from one pole each: that one is known, others are as on the map."""
    track, sensing = TRACKS["lsy-2"], Sensing("range", sensor_range=0.7, velocity_bias=0.0, fix_error=0.0)
    draw = perturbation(track, RACER, Randomisation(solid_shift=0.15), sensing=sensing)
    env = make_race_env(track, 1, RACER, "body-placed", perturb=draw)

    def begin(key):
        conditions = draw(key, (1, RACES))
        own = jnp.arange(RACES)
        beside = conditions.surroundings.gates.solids["pole"][:3, own, own] + jnp.array([[0.5], [0.0], [1.0]])
        state = env.begin(Start(beside[:, None], jnp.zeros((1, RACES)), jnp.zeros(RACES, jnp.int32)), conditions)
        return state, env.observe(perceive(state))

    state, seen = jax.jit(begin)(jax.random.key(0))
    true = np.asarray(env.course_of(state).solids["pole"])[:2]
    mapped = np.asarray(env.course.solids["pole"])[:2, :, None]
    here = np.asarray(state.drones.position_w)[:2, None, 0]
    known = np.linalg.norm(true - here, axis=0) <= 0.7
    assert known[np.arange(RACES), np.arange(RACES)].all()
    assert not known.all()
    believed = np.asarray(env.course_of(perceive(state)).solids["pole"])[:2, :, 0]
    np.testing.assert_allclose(believed, np.where(known, true, mapped), atol=1e-5)
    names = [entry.name for entry in env.layout("body-placed")]
    first = sum(entry.size for entry in env.layout("body-placed")[: names.index("pole_1")])
    offsets = np.clip((believed - here) / 2.0, -3, 3).swapaxes(0, 1).reshape(8, RACES)
    np.testing.assert_allclose(np.asarray(seen)[first : first + 8, 0], offsets, atol=1e-5)
