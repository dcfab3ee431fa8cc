"""Races that differ from what vehicle and track say: drawn as asked, and flown and seen as drawn."""

import dataclasses
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Gate, Randomisation
from cruise.dynamics import quaternion
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.randomise import LARGEST, NARROWER, NOISE, SMALLEST, made_for, perturbation
from cruise.env.surroundings import Conditions, Gusts, Surroundings, gust_w, perceive
from cruise.env.types import RaceState, race_rules
from cruise.errors import CruiseError
from cruise.presets import RANDOMISATION, TRACKS, VEHICLES
from cruise.racing.course import pick
from cruise.racing.random_track import random_tracks
from cruise.racing.solids import solid_columns
from tests.helpers import arrays

RING, RACER, PAPER = TRACKS["ring"], VEHICLES["racer"], VEHICLES["paper"]
RACES = 400
FULL = RANDOMISATION["racer"]
RULES = arrays(race_rules(RACER.agility, 0.25, 0))


def env_with(randomisation: Randomisation, drones: int = 2) -> RaceEnv:
    vehicle = made_for(RACER, randomisation)
    return make_race_env(RING, drones, vehicle, "body", perturb=perturbation(RING, vehicle, randomisation))


def started(env: RaceEnv, races: int, seed: int = 0) -> RaceState:
    return jax.jit(env.reset, static_argnums=1)(jax.random.key(seed), (races,))


def drawn(randomisation: Randomisation, drones: int = 2) -> RaceState:
    return started(env_with(randomisation, drones), RACES)


def test_physical_parameters_spread_evenly_drone_by_drone() -> None:
    parameters = drawn(FULL).drones.parameters
    airframe = RACER.airframe
    usual = {
        "mass": (RACER.mass, FULL.mass_spread),
        "thrust_gain": (1.0, FULL.thrust_spread),
        "horizontal_drag": (airframe.drag.horizontal, FULL.drag_spread),
        "vertical_drag": (airframe.drag.vertical, FULL.drag_spread),
        "rotor_lag": (airframe.rotors.time_constant, FULL.lag_spread),
        "rate_lag": (airframe.rates.time_constant, FULL.lag_spread),
    }
    for name, (value, spread) in usual.items():
        deviation = np.asarray(getattr(parameters, name)) / value - 1
        assert deviation.shape == (2, RACES)
        assert np.abs(deviation).max() <= spread * 1.0001
        np.testing.assert_allclose(deviation.std(), spread / np.sqrt(3), rtol=0.1)
        assert abs(np.corrcoef(deviation)[0, 1]) < 0.2
    inertia = np.asarray(parameters.inertia) / np.array(RACER.inertia)[:, None, None] - 1
    np.testing.assert_allclose(inertia.std(axis=(1, 2)), FULL.inertia_spread / np.sqrt(3), rtol=0.1)
    delay = np.asarray(parameters.delay)
    assert 0 <= delay.min() < 0.001
    assert FULL.extra_delay - 0.001 < delay.max() <= FULL.extra_delay
    cut = np.asarray(parameters.clip_share)
    assert (FULL.clip_share, cut.shape) == (1.0, (2, RACES))
    assert 0 <= cut.min() < 0.01
    assert 0.99 < cut.max() <= 1.0
    np.testing.assert_allclose(np.asarray(drawn(FULL.scaled(2.0)).drones.parameters.clip_share).mean(), 0.75, atol=0.05)
    wind = np.asarray(parameters.wind_w)
    np.testing.assert_array_equal(wind[:, 0], wind[:, 1])
    assert 0.9 * FULL.wind_speed < np.linalg.norm(wind, axis=0).max() <= FULL.wind_speed * 1.0001
    assert not wind[2].any()


def test_what_firmware_and_motors_are_like_comes_on_top_drone_by_drone() -> None:
    extra = Randomisation(extra_integral=20.0, extra_idle=0.1, extra_curve=0.3)
    drones = drawn(extra).drones
    highest = (20.0, 0.1 * RACER.airframe.rotors.max_thrust, 0.3)
    for name, most in zip(("integral_gain", "min_thrust", "thrust_curve"), highest, strict=True):
        value = np.asarray(getattr(drones.parameters, name))
        assert value.shape == (2, RACES)
        np.testing.assert_allclose([value.min(), value.mean(), value.max()], [0, most / 2, most], atol=0.06 * most)
    assert [wound.shape for wound in drones.memory.controller] == [(2, RACES)] * 3


def test_what_is_not_random_stays_out_of_the_state() -> None:
    plain = drawn(Randomisation())
    assert len(jax.tree.leaves((plain.drones.parameters, plain.surroundings))) == 0
    for name, value in dataclasses.asdict(FULL).items():
        if not value:
            continue
        state = drawn(dataclasses.replace(Randomisation(), **{name: value}))
        assert jax.tree.leaves((state.drones.parameters, state.surroundings)), name
    assert perturbation(RING, RACER, Randomisation()) is None


def test_tilted_gates_and_moved_solids_are_where_the_course_has_them() -> None:
    """Every race its own, evenly about the track's; the log of a race has them there."""
    track, most = TRACKS["lsy-2"], Randomisation(gate_tilt=0.1, solid_shift=0.15)
    env = make_race_env(track, 1, RACER, perturb=perturbation(track, RACER, most))
    state = jax.jit(env.reset, static_argnums=1)(jax.random.key(0), (RACES,))
    course = env.course_of(state)
    pitch, roll = np.arctan2(course.tilt[1], course.tilt[0]), np.arctan2(course.tilt[3], course.tilt[2])
    for turn in (pitch, roll):
        assert turn.shape == (4, RACES)
        np.testing.assert_allclose((np.abs(turn).max(), turn.std()), (0.1, 0.1 / np.sqrt(3)), rtol=0.1)
    for kind, still in solid_columns(track.obstacles).items():
        moved = np.asarray(course.solids[kind]) - still[:, :, None]
        assert np.abs(moved[:2]).max() == pytest.approx(0.15, rel=0.02)
        assert np.abs(moved[2:]).max() < 1e-6
    np.testing.assert_allclose(course.position_w[:, :, 0].T, [gate.position_w for gate in track.gates], atol=1e-6)


def test_milder_races_meet_one_part_of_all_that_is_random() -> None:
    """A share of the races is less random, every deviation of such a race by the same factor, evenly from 0 to 1."""
    vehicle = made_for(RACER, FULL)
    draw = jax.jit(perturbation(RING, vehicle, FULL, milder_share=0.5), static_argnums=1)
    conditions = draw(jax.random.key(0), (64, 2 * RACES))  # 64 drones: the farthest from the middle tells the spread
    moved = np.abs(np.asarray(conditions.parameters.mass) / RACER.mass - 1).max(axis=0) / FULL.mass_spread
    pulled = np.abs(np.asarray(conditions.parameters.thrust_gain) - 1).max(axis=0) / FULL.thrust_spread
    np.testing.assert_allclose(moved, pulled, atol=0.25)
    assert max(moved.max(), pulled.max()) <= 1.0001
    milder = moved < 0.85
    assert np.mean(milder) == pytest.approx(0.5 * 0.86, abs=0.07)
    np.testing.assert_allclose(np.quantile(moved[milder], [0.25, 0.5, 0.75]), [0.21, 0.42, 0.63], atol=0.08)


def test_nominal_races_are_as_vehicle_and_track_say() -> None:
    """In a share of the races every number is the vehicle's own, in the others hardly any."""
    draw = jax.jit(perturbation(RING, made_for(RACER, FULL), FULL, nominal_share=0.5), static_argnums=1)
    parameters, surroundings = draw(jax.random.key(0), (2, RACES))
    nominal = np.asarray(surroundings.gusts.speed) == 0
    assert np.mean(nominal) == pytest.approx(0.5, abs=0.06)
    assert not np.asarray(surroundings.errors.bias)[..., nominal].any()
    np.testing.assert_allclose(
        surroundings.gates.position_w[:, 0, nominal], [[x] * nominal.sum() for x in RING.gates[0].position_w]
    )
    for name, own in (("mass", RACER.mass), ("thrust_gain", 1.0), ("clip_share", 0.0), ("delay", 0.0)):
        is_own = np.isclose(np.asarray(getattr(parameters, name)), own, rtol=1e-6, atol=0).all(axis=0)
        np.testing.assert_array_equal(is_own, nominal, err_msg=name)


def test_a_longer_delay_is_remembered() -> None:
    late = FULL.scaled(2.0)
    assert made_for(RACER, late).airframe.longest_delay == pytest.approx(2 * FULL.extra_delay)
    assert drawn(late).drones.memory.commands.shape[0] == 2


def test_moved_gates_are_those_of_a_track_that_has_them_there() -> None:
    """Start, observation and step in a race with moved gates are those on a track built so."""
    moved = env_with(Randomisation(gate_shift=0.5, gate_turn=0.3))
    state = started(moved, 4, seed=3)
    course = moved.course_of(state)
    shift = np.asarray(course.position_w) - np.array([g.position_w for g in RING.gates]).T[:, :, None]
    assert 0.4 < np.abs(shift).max() <= 0.5001
    state = state._replace(drones=state.drones._replace(body=before_the_gate(moved, state)))
    action = jnp.zeros((4, 2, 4))
    after, outcome = jax.jit(moved.step)(state, action, RULES)
    assert np.asarray(outcome.crossing.passed).all()
    for race in range(4):
        yaw = np.arctan2(*np.asarray(course.normal_w)[::-1, :, race])
        gates = (Gate(tuple(map(float, course.position_w[:, g, race])), float(yaw[g])) for g in range(len(RING.gates)))
        there = make_race_env(dataclasses.replace(RING, gates=tuple(gates)), 2, RACER, "body")
        alone = jax.tree.map(lambda x, race=race: x[..., race], state)._replace(surroundings=Surroundings())
        np.testing.assert_allclose(moved.observe(state)[..., race], there.observe(alone), atol=1e-5)
        other, same = jax.jit(there.step)(alone, action[..., race], RULES)
        np.testing.assert_allclose(outcome.reward[:, race], same.reward, atol=1e-4)
        np.testing.assert_allclose(outcome.crossing.offset[:, race], same.crossing.offset, atol=1e-5)
        np.testing.assert_array_equal(after.next_gate[:, race], other.next_gate)


def before_the_gate(env: RaceEnv, state: RaceState):
    """Every drone 0.1 m before the middle of its gate, flying through at 15 m/s, one above the other."""
    course = env.course_of(state)
    gate, race = np.asarray(state.next_gate), np.arange(4)
    centre, normal = np.asarray(course.position_w)[:, gate, race], np.asarray(course.normal_w)[:, gate, race]
    forward = np.concatenate([normal, np.zeros_like(normal[:1])])
    height = np.zeros_like(centre)
    height[2] = np.array([[-0.5], [0.5]])
    return state.drones.body._replace(
        position_w=jnp.asarray(centre + height - 0.1 * forward, jnp.float32),
        velocity_w=jnp.asarray(15 * forward, jnp.float32),
    )


def test_no_gate_is_moved_into_the_ground() -> None:
    eight = TRACKS["figure-eight"]
    env = make_race_env(eight, 1, RACER, perturb=perturbation(eight, RACER, Randomisation(gate_shift=1.0)))
    height = np.asarray(env.course_of(started(env, RACES)).position_w)[2]
    usual = np.array([gate.position_w[2] for gate in eight.gates])
    assert (height >= np.minimum(usual, 1.0)[:, None] - 1e-6).all()
    assert (height > usual[:, None] + 0.9).any()


def test_gusts_are_as_strong_as_asked_and_die_down() -> None:
    """Over time and races: no mean, the root mean square asked for along every axis, related over a second or so."""
    phase = jax.random.uniform(jax.random.key(1), (3, 4, RACES), maxval=2 * jnp.pi)
    gusts = Gusts(jnp.full(RACES, 1.5), phase)
    air = np.stack([np.asarray(gust_w(gusts, jnp.full(RACES, t))) for t in np.arange(0, 12, 0.1)])
    np.testing.assert_allclose(air.mean(axis=(0, 2)), 0.0, atol=0.05)
    np.testing.assert_allclose(np.sqrt((air**2).mean(axis=(0, 2))), 1.5, rtol=0.03)
    related = [(air[lag:] * air[: len(air) - lag]).mean() / (air**2).mean() for lag in (1, 5, 10)]
    assert 0.85 < related[0] < 1
    assert related[0] > related[1] > related[2]
    assert abs(related[2]) < 0.5


def test_no_lap_meets_the_air_of_the_lap_before() -> None:
    """Whatever a lap lasts, up to a minute, the air of a race is not the same again."""
    phase = jax.random.uniform(jax.random.key(2), (3, 4, 60), maxval=2 * jnp.pi)
    times = jnp.arange(0, 180, 0.1)
    air = np.asarray(jax.vmap(lambda t: gust_w(Gusts(jnp.ones(60), phase), jnp.full(60, t)))(times))
    energy = (air**2).mean()
    alike = [(air[lag:] * air[:-lag]).mean() / energy for lag in range(20, 600)]
    assert max(alike) < 0.9


def test_all_drag_spreads_quadratic_drag_too() -> None:
    """Each term by its own deviation; a term that is off stays out of the state."""
    drag = dataclasses.replace(RACER.airframe.drag, quadratic=0.03)
    body = dataclasses.replace(RACER, airframe=dataclasses.replace(RACER.airframe, drag=drag))
    for vehicle, there in ((body, True), (RACER, False)):
        draw = jax.jit(perturbation(RING, vehicle, Randomisation(drag_spread=0.4)), static_argnums=1)
        parameters = draw(jax.random.key(0), (2, RACES)).parameters
        assert (parameters.quadratic_drag is not None) == there
        if there:
            deviation = np.asarray(parameters.quadratic_drag) / 0.03 - 1
            assert 0.35 < np.abs(deviation).max() <= 0.4001
            linear = np.asarray(parameters.horizontal_drag) / drag.horizontal - 1
            assert abs(np.corrcoef(deviation.ravel(), linear.ravel())[0, 1]) < 0.15


def test_gusts_push_a_drone_by_its_drag() -> None:
    """At rest, a = d_h w / m in the plane of the rotors."""
    strong = Gusts(jnp.full(1, 5.0), jnp.full((3, 4, 1), jnp.pi / 2))
    env = make_race_env(RING, 1, RACER, perturb=lambda key, shape: Conditions(surroundings=Surroundings(gusts=strong)))
    hover = jnp.zeros((4, 1, 1)).at[0].set(2 * 9.81 / RACER.agility - 1)
    after, _ = jax.jit(env.step)(started(env, 1), hover, RULES)
    wind = np.asarray(gust_w(strong, jnp.zeros(1)))[:2, 0]
    gain = RACER.airframe.drag.horizontal / RACER.mass * RACER.control_dt
    np.testing.assert_allclose(after.drones.velocity_w[:2, 0, 0], gain * wind, rtol=0.02)


def test_sensors_are_wrong_by_a_bias_for_a_race_and_noise_at_every_step() -> None:
    state = drawn(Randomisation(position_error=0.2, rate_error=0.1))
    seen = [perceive(state._replace(step=jnp.full(RACES, k))) for k in range(30)]
    for field, error in (("position_w", 0.2), ("angular_velocity_b", 0.1)):
        truth = np.asarray(getattr(state.drones, field))
        wrong = np.stack([np.asarray(getattr(race.drones, field)) for race in seen]) - truth
        bias = wrong.mean(axis=0)
        np.testing.assert_allclose(bias.std(), error, rtol=0.1)
        np.testing.assert_allclose((wrong - bias).std(), NOISE * error, rtol=0.1)
        steps = (wrong - bias)[:, 0, 0]
        assert abs(np.corrcoef(steps[:-1].ravel(), steps[1:].ravel())[0, 1]) < 0.1
        assert abs(np.corrcoef(bias[0, 0], bias[0, 1])[0, 1]) < 0.2
    np.testing.assert_array_equal(seen[3].drones.velocity_w, state.drones.velocity_w)
    again = perceive(state._replace(step=jnp.full(RACES, 3)))
    np.testing.assert_array_equal(again.drones.position_w, seen[3].drones.position_w)
    one = perceive(jax.tree.map(lambda x: x[..., 5], state._replace(step=jnp.full(RACES, 3))))
    np.testing.assert_allclose(one.drones.position_w, seen[3].drones.position_w[..., 5], atol=1e-6)


def test_attitude_is_wrong_by_an_angle() -> None:
    """About each axis of the body by the angle asked for, and a unit quaternion still."""
    state = drawn(Randomisation(attitude_error=0.02))
    truth, seen = (np.asarray(race.drones.body.attitude) for race in (state, perceive(state)))
    np.testing.assert_allclose(np.linalg.norm(seen, axis=0), 1.0, atol=1e-6)
    angle = 2 * np.arccos(np.clip((truth * seen).sum(axis=0), -1, 1))
    np.testing.assert_allclose(np.sqrt((angle**2).mean()), 0.02 * np.sqrt(3 * (1 + NOISE**2)), rtol=0.1)
    heading = quaternion.from_heading(jnp.float32(0.3))
    turned = quaternion.turned(heading, jnp.array([0.0, 0.0, 0.4]))
    np.testing.assert_allclose(turned, quaternion.from_heading(jnp.float32(0.7)), atol=1e-6)


def test_the_papers_vehicle_has_gates_and_sensors_to_differ() -> None:
    there = RANDOMISATION["paper"]
    env = make_race_env(RING, 2, made_for(PAPER, there), perturb=perturbation(RING, PAPER, there))
    state = started(env, RACES)
    wrong = np.asarray(perceive(state).drones.body.euler)
    np.testing.assert_allclose(wrong.std(), 0.015 * np.sqrt(1 + NOISE**2), rtol=0.1)
    assert np.asarray(env.observe(perceive(state))).shape == env.observe(state).shape


@pytest.mark.parametrize(
    ("changes", "vehicle", "complaint"),
    [
        ({"mass_spread": 1.0}, RACER, "mass_spread must be below 1, not 1.0"),
        ({"wind_speed": -1.0}, RACER, "wind_speed must be 0 or more, not -1.0"),
        ({"gate_turn": float("nan")}, RACER, "gate_turn must be 0 or more, not nan"),
        ({"thrust_spread": 0.1}, PAPER, "thrust_spread needs a vehicle with an airframe, and 'paper' has none"),
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict, vehicle, complaint: str) -> None:
    with pytest.raises(CruiseError, match=complaint):
        made_for(vehicle, Randomisation(**changes))


def test_every_race_gets_a_variant_of_the_track_as_it_stands():
    track = random_tracks(0, 5)
    env = make_race_env(track, 2, RACER, "body")
    course = env.course_of(started(env, 200))
    tables = np.array([[gate.position_w for gate in gates] for gates in track.variants], np.float32)
    yaws = np.array([[gate.yaw for gate in gates] for gates in track.variants])
    drawn = np.moveaxis(np.asarray(course.position_w), 2, 0).swapaxes(1, 2)
    which = [np.flatnonzero((tables == race).all((1, 2))) for race in drawn]
    assert all(len(found) == 1 for found in which)
    chosen = np.concatenate(which)
    assert set(chosen) == set(range(5))
    expected = np.stack([np.cos(yaws[chosen]), np.sin(yaws[chosen])])
    np.testing.assert_allclose(np.moveaxis(np.asarray(course.normal_w), 2, 1), expected, atol=1e-6)


def test_gates_of_a_variant_are_moved_too():
    track = random_tracks(0, 5)
    shifted = Randomisation(gate_shift=0.1)
    env = make_race_env(track, 1, RACER, "body", perturb=perturbation(track, RACER, shifted))
    course = env.course_of(started(env, 50))
    tables = np.array([[gate.position_w for gate in gates] for gates in track.variants], np.float32)
    drawn = np.moveaxis(np.asarray(course.position_w), 2, 0).swapaxes(1, 2)
    nearest = np.abs(drawn[:, None] - tables).max((2, 3)).min(1)
    assert 0 < nearest.min() <= nearest.max() <= 0.1 + 1e-5


def test_a_reshaped_track_is_one_of_the_variants_mirrored_turned_round_and_stretched():
    track = replace(random_tracks(0, 5), reshaped=True)
    draw = perturbation(track, VEHICLES["racer"], Randomisation())
    gates = draw(jax.random.key(0), (1, 64)).surroundings.gates
    place, normal, size = (np.asarray(x, np.float64) for x in gates[:3])
    legs = [np.linalg.norm(np.diff([g.position_w[:2] for g in v + v[:1]], axis=0), axis=1) for v in track.variants]
    openings = np.array([gate.width for gate in track.gates])
    seen = set()
    for race in range(64):
        level = np.concatenate([place[:2, :, race], place[:2, :1, race]], axis=1).T
        along = np.linalg.norm(np.diff(level, axis=0), axis=1)
        fits = {  # gates that stand one above the other have no leg
            (variant, turned): (along[:-1][::-1].tolist() + along[-1:].tolist() if turned else along)
            / np.where(legs[variant] > 0, legs[variant], np.nan)
            for variant in range(5)
            for turned in (False, True)
        }
        (variant, turned), ratio = min(fits.items(), key=lambda fit: np.ptp(fit[1][np.isfinite(fit[1])]))
        ratio = ratio[np.isfinite(ratio)]
        assert np.ptp(ratio) < 1e-3
        assert ratio.mean() + 1e-3 >= SMALLEST
        assert ratio.mean() - 1e-3 <= LARGEST
        wider = 2 * size[0, :, race] / np.sqrt(ratio.mean()) / (openings[::-1] if turned else openings)
        assert (wider > NARROWER - 1e-3).all()
        np.testing.assert_allclose(np.linalg.norm(normal[:, :, race], axis=0), 1, atol=1e-6)
        assert (place[2, :, race] >= size[1, :, race] - 1e-6).all()
        seen.add((variant, turned))
    assert len(seen) == 10


def test_races_on_random_tracks_start_before_their_own_gates():
    track = random_tracks(0, 5)
    env = make_race_env(track, 1, RACER, "body")
    state = started(env, 100)
    course = env.course_of(state)
    centre, normal = pick(course.position_w, state.next_gate), pick(course.normal_w, state.next_gate)
    offset = state.drones.position_w - centre
    forward = np.asarray(offset[0] * normal[0] + offset[1] * normal[1])
    assert forward.max() < -1.0
    assert forward.min() > -3.5
