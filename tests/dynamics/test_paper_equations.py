"""The `paper` preset is the paper's vehicle: equal to an independent float64 transcription over 10 s of flight."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.presets import CURRICULUM, VEHICLES
from tests.dynamics import paper_reference as paper
from tests.dynamics.bodies import at_rest, chattering_actions, fly, smooth_actions

STEPS, PER_STAGE = 100, 4  # 10 s; flights of each kind of action with the agility of each stage
FIELDS = ("position_w", "velocity_w", "euler", "angular_velocity_b")


def flights() -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Starts {field: [3, D]}, actions [T, 3, D] and agilities [D]: smooth and chattering, at rest and tumbling."""
    rng = np.random.default_rng(0)
    agility = np.repeat([stage.agility for stage in CURRICULUM], PER_STAGE)
    count = agility.size
    actions = np.concatenate([smooth_actions(rng, STEPS, count), chattering_actions(rng, STEPS, count)], axis=2)
    agility = np.tile(agility, 2)
    low, high = [[-5.0], [-5.0], [0.3]], [[5.0], [5.0], [6.0]]
    tumbling = rng.random(2 * count) < 0.5
    starts = {
        "position_w": rng.uniform(low, high, (3, 2 * count)),
        "velocity_w": tumbling * rng.uniform(-3, 3, (3, 2 * count)),
        "euler": tumbling * rng.uniform(-0.7, 0.7, (3, 2 * count)),
        "angular_velocity_b": tumbling * rng.uniform(-1, 1, (3, 2 * count)),
    }
    # Numbers that float32 holds exactly, so that both precisions start from the same flight.
    exact = {name: value.astype(np.float32).astype(np.float64) for name, value in starts.items()}
    return exact, actions.astype(np.float32).astype(np.float64), agility


def reference(starts: dict[str, np.ndarray], actions: np.ndarray, agility: np.ndarray) -> dict[str, np.ndarray]:
    """The same flights by the transcription, [T, 3, D]."""
    flown = []
    for d in range(agility.size):
        drone = paper.Drone(*(starts[name][:, d].copy() for name in FIELDS))
        flown.append(paper.fly(drone, actions[:, :, d], agility[d]))
    return {name: np.stack([f[name] for f in flown], axis=-1) for name in FIELDS}


@pytest.mark.parametrize(("x64", "tolerance"), [(False, 1e-4), (True, 1e-6)], ids=["float32", "float64"])
def test_equals_the_transcription_over_ten_seconds(x64: bool, tolerance: float) -> None:
    starts, actions, agility = flights()
    expected = reference(starts, actions, agility)
    with jax.enable_x64(x64):
        dtype = jnp.float64 if x64 else jnp.float32
        state = at_rest(VEHICLES["paper"], starts["position_w"].astype(dtype))
        state = state._replace(body=state.body._replace(**{k: jnp.asarray(v, dtype) for k, v in starts.items()}))
        flown = fly(VEHICLES["paper"], state, jnp.asarray(actions, dtype), agility)
        for name in FIELDS:
            assert getattr(flown.body, name).dtype == dtype
            np.testing.assert_allclose(getattr(flown.body, name), expected[name], rtol=0, atol=tolerance, err_msg=name)


def test_the_flights_reach_what_could_differ() -> None:
    """The ground, a thrust that would be negative and attitudes far from level all occur in the comparison."""
    starts, actions, agility = flights()
    flown = reference(starts, actions, agility)
    assert (flown["position_w"][:, 2] == 0).any()
    unclipped = 9.81 + 7.5 * np.diff(np.clip(actions[:, 2], -1, 1), axis=0)[:, -1]
    assert (unclipped < 0).any()
    assert np.abs(flown["euler"][:, 0]).max() > 0.5
    assert np.abs(flown["euler"][:, 2]).max() > 0.3


def test_printed_gains_and_body() -> None:
    vehicle = VEHICLES["paper"]
    gains = vehicle.controller
    assert (vehicle.mass, vehicle.inertia, vehicle.gravity) == (1.0, (0.005, 0.005, 0.009), 9.81)
    assert (vehicle.control_dt, vehicle.integrator, vehicle.substeps) == (0.1, "euler", 1)
    assert (gains.velocity_p, gains.velocity_d) == (0.42, 2.0)
    assert (gains.position_p, gains.position_d) == (5.0, 0.05)
    assert (gains.attitude_p, gains.attitude_d) == (0.1, 0.05)
    assert [s.agility for s in CURRICULUM] == [2.0, 3.0, 4.0, 6.0, 7.5]


def test_sustained_acceleration_has_the_documented_limit() -> None:
    """A constant full action accelerates by K_p K_v alpha dt = 1.575 m/s^2 after the kick of its first step."""
    actions = np.zeros((40, 3, 1), np.float32)
    actions[:, 2] = 1.0
    start = np.array([[0.0], [0.0], [1.0]], np.float32)
    flown = fly(VEHICLES["paper"], at_rest(VEHICLES["paper"], start), actions, 7.5)
    climb = np.asarray(flown.body.velocity_w)[:, 2, 0]
    expected = 5 * 0.42 * 7.5 * 0.1 - 0.05 * climb[1:-1]
    np.testing.assert_allclose(np.diff(climb)[1:] / 0.1, expected, atol=1e-4)


@pytest.mark.parametrize("agility", [2.0, 7.5])
def test_hover_is_an_equilibrium(agility: float) -> None:
    start = np.array([[1.0], [-2.0], [3.0]], np.float32)
    flown = fly(VEHICLES["paper"], at_rest(VEHICLES["paper"], start), np.zeros((200, 3, 1), np.float32), agility)
    np.testing.assert_array_equal(flown.body.position_w, np.broadcast_to(start, (200, 3, 1)))
    np.testing.assert_array_equal(flown.body.euler, 0)
