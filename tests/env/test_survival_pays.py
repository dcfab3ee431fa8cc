"""Who keeps flying earns more than who crashes: at every stage, at every speed, with the default weights.

The paper's printed weights break this, which is why they are not the default.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import PPOConfig, RewardWeights, Stage, Track
from cruise.presets import CURRICULUM, REWARDS
from tests.env.races import EIGHT, PAPER, RING, Recorded, fly_to_gates, lined_up, race_env, record, rules_of
from tests.env.steps import components_and_total, crossing_of

GAMMA, DT = PPOConfig().gamma, PAPER.control_dt
HORIZON = 2000  # steps; what comes later is discounted to 1e-8
DEFAULT, PRINTED = REWARDS["default"], REWARDS["paper"]
stages = pytest.mark.parametrize("stage", CURRICULUM, ids=lambda s: s.name)


def top_speed(stage: Stage) -> float:
    """Where the controller's damping eats its sustained acceleration, far beyond what a track allows [m/s]."""
    gains = PAPER.controller
    return gains.position_p * gains.velocity_p * stage.agility * DT / gains.position_d


def gate_spacing(track: Track) -> float:
    """Mean distance from gate to gate [m]."""
    gates = np.array([g.position_w for g in track.gates])
    return float(np.linalg.norm(np.roll(gates, -1, axis=0) - gates, axis=1).mean())


def steady_flight(weights: RewardWeights, stage: Stage, speed: float, spacing: float, offset: float) -> np.ndarray:
    """Rewards, step by step, of one drone flying straight through gate after gate, HORIZON steps.

    `offset` is how far beyond the edge of the opening it passes each gate, negative inside [m].
    """
    flown = speed * DT * np.arange(HORIZON + 1)
    gate = (np.floor(flown[:-1] / spacing) + 1) * spacing
    passed = (flown[1:] >= gate)[None]
    path = np.stack([flown, np.full_like(flown, 1.0 + offset), 0 * flown])[:, None].astype(np.float32)
    centre = np.stack([gate, 0 * gate, 0 * gate])[:, None].astype(np.float32)
    velocity = np.zeros_like(centre) + np.float32([speed, 0, 0])[:, None, None]
    reward = _reward(weights)(path, velocity, centre, passed, np.float32(offset), rules_of(stage))
    return np.asarray(reward, np.float64)[0]


@functools.cache
def _reward(weights: RewardWeights) -> Callable[..., jax.Array]:
    """The reward of a lonely drone on its path [3, 1, HORIZON + 1] through 2 m wide gates, compiled."""

    def compute(path, velocity, centre, passed, offset, rules):
        none = jnp.zeros_like(passed)
        step = {"p0": path[..., :-1], "p1": path[..., 1:], "v0": velocity, "v1": velocity, "gate": centre}
        step |= {"normal": jnp.zeros_like(centre[:2]).at[0].set(1.0), "nearest": jnp.full(passed.shape, jnp.inf)}
        step |= {"flying": ~none, "collided": none}
        return components_and_total(weights, step, rules, crossing_of(passed, offset), none)[1]

    return jax.jit(compute)


def returns(rewards: np.ndarray) -> np.ndarray:
    """Discounted return from each of the first 200 steps on, [200]."""
    discount = GAMMA ** np.arange(rewards.size)
    return np.array([rewards[k:] @ discount[: rewards.size - k] for k in range(200)])


@pytest.mark.parametrize("track", [RING, EIGHT], ids=lambda t: t.name)
@stages
def test_steady_flight_beats_crashing_at_any_speed(stage: Stage, track: Track) -> None:
    """From a crawl to the fastest this stage can fly, through the middle of the gates or at the rim, at any moment."""
    for speed in np.geomspace(0.5, top_speed(stage), 6):
        for offset in (-1.0, stage.gate_tolerance):
            rewards = steady_flight(DEFAULT, stage, float(speed), gate_spacing(track), offset)
            assert returns(rewards).min() > DEFAULT.terminal, f"at {speed:.2f} m/s, {offset} m beyond the edge"


@stages
def test_hovering_beats_crashing(stage: Stage) -> None:
    """Even who waits for ever."""
    rewards = steady_flight(DEFAULT, stage, 0.0, gate_spacing(RING), -1.0)
    assert returns(rewards).min() > DEFAULT.terminal


@stages
def test_faster_is_better_up_to_the_reference_speed(stage: Stage) -> None:
    """Otherwise survival would pay by dawdling."""
    speeds = np.linspace(0.5, min(stage.v_min, 5.0), 6) if stage.v_min > 1 else np.array([0.25, 0.5, 1.0])
    earned = [returns(steady_flight(DEFAULT, stage, float(v), gate_spacing(RING), -1.0))[0] for v in speeds]
    assert (np.diff(earned) > 0).all()


def returns_of(flight: Recorded) -> np.ndarray:
    """Discounted return of each race's drone from the start, [E]."""
    rewards = flight.outcome.reward[:, 0].astype(np.float64)
    return (GAMMA ** np.arange(rewards.shape[0])) @ rewards


@stages
def test_flights_of_a_plain_pilot_beat_crashing(stage: Stage) -> None:
    """In the environment itself, from every start: gates are met, corners are flown, nothing is idealised."""
    env, speeds = race_env(1), np.repeat([0.5, 1.0, 2.0, 3.0], 16)
    flight = fly_to_gates(env, lined_up(env, RING, speeds.size), 400, speeds, rules_of(stage))
    assert not flight.after.out.any()
    assert flight.after.gates_passed[-1].min() > 0
    assert returns_of(flight).min() > DEFAULT.terminal


@stages
def test_every_way_to_crash_ends_with_the_terminal_reward(stage: Stage) -> None:
    """No crash earns more in its last step than the return that survival is compared with."""
    env = race_env(2)
    start = lined_up(env, RING, 32)
    wild = np.random.default_rng(0).choice([-1.0, 1.0], (1, 3, 2, 32)).astype(np.float32).repeat(200, axis=0)
    flight = record(env, start, wild, rules_of(stage))
    assert flight.outcome.terminated.sum() > 20
    np.testing.assert_array_equal(flight.outcome.reward[flight.outcome.terminated], np.float32(DEFAULT.terminal))
    assert DEFAULT.terminal <= -DEFAULT.clip


def test_printed_weights_make_dying_attractive_at_the_last_stage() -> None:
    """The documented defect: at 4.4 m/s the speed term is -1.1 a step, and slow flight earns less than a crash."""
    last = CURRICULUM[-1]
    assert PRINTED.w_speed * (4.4 - last.v_min) == pytest.approx(-1.1, abs=0.05)
    spacing = gate_spacing(RING)
    slow = steady_flight(PRINTED, last, 2.0, spacing, -1.0)
    assert slow.mean() < -0.5
    assert returns(slow).max() < PRINTED.terminal
    assert returns(steady_flight(DEFAULT, last, 2.0, spacing, -1.0)).min() > 0
