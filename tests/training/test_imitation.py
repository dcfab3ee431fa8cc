"""Cloning people: what logs do not have is found again, and a clone does what it was shown."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.cli.train import Train
from cruise.errors import CruiseError
from cruise.evaluation.matches import make_match, run_races
from cruise.pilots.human import HUMAN
from cruise.presets import TRACKS, VEHICLES, training_config
from cruise.storage.policy_file import load_policy
from cruise.training import imitation
from cruise.training.imitation import clone, load_demonstrations, state_of, write_clone
from cruise.training.initial_state import initial_state
from tests.training.runs import TINY, shared_trainer

RING = TRACKS["ring"]
CONFIG = replace(training_config("racer", 2), critic_observation="")


@pytest.fixture(scope="module")
def log():
    """Two chasers, one of whom goes by a person's name."""
    match = make_match(RING, 2, "chaser", laps=2, vehicle="racer")
    (flown,) = run_races(match, 1, seed=1)
    return replace(flown, pilots=np.array([f"{HUMAN} Ada", "chaser"]))


def test_body_rates_and_commands_are_found_again(log):
    """What the drone did in a step follows from the state that is made of its log."""
    match = make_match(RING, 2, "chaser", laps=2, vehicle="racer")
    state = state_of(match.env, log)
    rates = np.asarray(state.drones.angular_velocity_b)
    turn = np.asarray(match.env.dynamics.rotation(state.drones))  # [3, 3, N, T]
    steps = np.einsum("kint,kjnt->ijnt", turn[..., :-1], turn[..., 1:])
    felt = np.stack([steps[2, 1] - steps[1, 2], steps[0, 2] - steps[2, 0], steps[1, 0] - steps[0, 1]]) / 2
    middle = (rates[..., :-1] + rates[..., 1:]) / 2
    flown = log.airborne[:-1].T & log.airborne[1:].T
    np.testing.assert_allclose((felt / log.control_dt)[:, flown], middle[:, flown], atol=0.5)  # of 10 rad/s
    commands = np.asarray(state.drones.memory.commands)
    np.testing.assert_array_equal(commands[0, :, 0, 5], log.action[4, 0])


def test_a_clone_does_what_it_was_shown(log, monkeypatch, tmp_path):
    monkeypatch.setattr(imitation, "STEPS", 1500)
    path, made = write_clone(tmp_path, CONFIG, RING, [log])
    assert made.error < 0.5 * made.scatter
    pilot = load_policy(path)
    env = make_match(RING, 2, "chaser", laps=2, vehicle="racer").env
    state = state_of(env, log)
    _, action = pilot.act(env, (0, 1), pilot.init(env, (0, 1), state), state, jax.random.key(0))
    did, shown = np.asarray(action)[:, 0, :-50], log.action[:-50, 0].T
    assert np.sqrt(np.mean((did - shown) ** 2)) < 0.6 * shown.std()


def test_actions_in_a_gate_s_frame_are_turned_there():
    """The paper's policies speak in the frame of a gate: turned and turned back an action is itself."""
    env = make_match(RING, 2, "chaser").env
    (log,) = run_races(make_match(RING, 2, "chaser", laps=1), 1, seed=1)
    state = state_of(env, log)
    _, action = imitation._seen(env, "extended", state, log)
    back = env.decode_as["extended"](state, action)
    np.testing.assert_allclose(np.moveaxis(np.asarray(back), 0, -1).swapaxes(0, 1), log.action, atol=1e-5)


def test_a_training_starts_from_the_clone_of_a_folder_of_races(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(imitation, "STEPS", 50)
    (flown,) = run_races(make_match(RING, 2, "chaser", laps=1), 1, seed=1)
    replace(flown, pilots=np.array([HUMAN, "chaser"])).save(tmp_path / "flights" / "a.npz")
    command = Train(config=TINY, demonstrations=tmp_path / "flights")
    config = command._imitate(tmp_path / "run", TINY, RING)
    assert capsys.readouterr().out.startswith(f"cloned   {tmp_path}/run/cloned.safetensors: ")
    state = initial_state(shared_trainer(config))
    cloned = load_policy(config.start_from).params
    for mine, theirs in zip(jax.tree.leaves(state.model), jax.tree.leaves(cloned), strict=True):
        np.testing.assert_array_equal(np.asarray(mine), np.asarray(theirs))
    with pytest.raises(CruiseError, match="--demonstrations goes with neither --start-from nor --coordinator"):
        command._imitate(tmp_path / "run", config, RING)


def test_what_rivals_flew_does_not_matter(log):
    """In a mixed field actions are as wide as the widest."""
    wide = np.pad(log.action, [(0, 0), (0, 0), (0, 2)])
    mixed = replace(log, vehicles=np.array(["racer", "kolibri"]), vehicle="racer, kolibri", action=wide)
    (mine,), (own,) = (list(imitation._of_people(one, CONFIG, RING, VEHICLES["racer"])) for one in (mixed, log))
    np.testing.assert_array_equal(mine.action, own.action)


def test_what_cannot_be_cloned(log, tmp_path):
    racer = VEHICLES["racer"]
    with pytest.raises(CruiseError, match="no race logs"):
        load_demonstrations(tmp_path)
    with pytest.raises(CruiseError, match="fewer than 100 control steps flown by people"):
        clone(CONFIG, RING, racer, [replace(log, pilots=np.array(["chaser", "chaser"]))])
    with pytest.raises(CruiseError, match="were flown on 'ring', this run trains on 'figure-eight'"):
        clone(CONFIG, TRACKS["figure-eight"], racer, [log])
    with pytest.raises(CruiseError, match="were flown in 'racer', this run trains for 'racer-5'"):
        clone(CONFIG, RING, VEHICLES["racer-5"], [log])
    with pytest.raises(CruiseError, match="without memory"):
        clone(replace(CONFIG, ppo=replace(CONFIG.ppo, network="gru")), RING, racer, [log])


def test_nobody_learns_from_what_led_to_a_crash(log):
    crash = np.array([imitation.EVENT_KINDS.index("collision_ground")], np.int32)
    at = log.time[60]
    crashed = replace(
        log,
        event_time=np.array([at]),
        event_drone=np.zeros(1, np.int32),
        event_kind=crash,
        event_gate=np.full(1, -1, np.int32),
        event_other=np.full(1, -1, np.int32),
    )
    (samples,) = imitation._of_people(crashed, CONFIG, RING, VEHICLES["racer"])
    assert samples.action.shape[1] == int((log.time < at - imitation.BEFORE_A_CRASH).sum())
    assert jnp.isfinite(jnp.asarray(samples.observation)).all()
