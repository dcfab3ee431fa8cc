"""What sticks mean: rates as Betaflight has them, and the same demand by every loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.env.race_env import make_race_env
from cruise.pilots.human import ACRO, ANGLE, ASSISTED, HOLD, flight_modes, human_pilot, stick_rate
from cruise.presets import TRACKS, VEHICLES

RACER = VEHICLES["racer"]
RATES = np.array([[2.0, 8.0, 0.5], [2.0, 8.0, 0.5], [1.0, 3.0, 0.0]])


def actual_rates(stick, centre, most, expo):
    """As Betaflight's manual has them, in its own terms."""
    share = abs(stick) * (stick**5 * expo + stick * (1 - expo))
    return stick * centre + max(0.0, most - centre) * share


@pytest.mark.parametrize("stick", [-1.0, -0.4, 0.0, 0.1, 0.7, 1.0])
@pytest.mark.parametrize("rate", [(1.2, 11.7, 0.54), (3.0, 3.0, 0.0), (4.0, 2.0, 1.0)])
def test_rates_are_actual_rates(stick, rate):
    assert float(stick_rate(jnp.float32(stick), jnp.array(rate))) == pytest.approx(actual_rates(stick, *rate), abs=1e-5)
    assert float(stick_rate(jnp.float32(1.0), jnp.array(rate))) == pytest.approx(max(rate[0], rate[1]), rel=1e-5)


def test_modes_are_what_an_action_can_say():
    modes = {name: flight_modes(vehicle) for name, vehicle in VEHICLES.items()}
    assert modes["racer"] == ("assisted", "angle", "acro")
    assert modes["paper"] == ("assisted",)


@pytest.fixture(scope="module")
def act():
    """The action of a person in a racer that hovers before gate 1, by mode, sticks and kind of throttle."""
    env = make_race_env(TRACKS["ring"], 2, RACER)
    pilot = human_pilot("racer")
    state = env.reset(jax.random.key(0), (1,), 0)
    start = pilot.init(env, (0,), state)
    fly = jax.jit(lambda controls: pilot.act(env, (0,), controls, state, jax.random.key(0))[1])

    def act_(mode, sticks, centred=1.0):
        controls = start._replace(
            sticks=jnp.array(sticks, jnp.float32)[:, None, None],
            mode=jnp.full((1, 1), mode, jnp.int32),
            rates=jnp.array(RATES, jnp.float32)[..., None, None],
            tilt=jnp.full((1, 1), 0.8, jnp.float32),
            speed=jnp.full((1, 1), 6.0, jnp.float32),
            centred=jnp.full((1, 1), centred, jnp.float32),
        )
        return np.asarray(fly(controls))[:, 0, 0]

    return act_


def thrust(action):
    return RACER.agility * (action[0] + 1) / 2


def test_acro_is_thrust_and_rates(act):
    highest = np.array(RACER.airframe.rates.highest)
    action = act(ACRO, [0.5, -1.0, 0.3, 0.0])
    wanted = [actual_rates(stick, *rate) for stick, rate in zip([0.5, -1.0, -0.3], RATES, strict=True)]
    np.testing.assert_allclose(action[1:] * highest, wanted, rtol=1e-4)  # yaw right is negative about up
    assert thrust(action) == pytest.approx(RACER.gravity, rel=1e-4)


@pytest.mark.parametrize(
    ("throttle", "centred", "wanted"),
    [
        (-1.0, 1.0, 0.0),
        (0.0, 1.0, RACER.gravity),
        (1.0, 1.0, RACER.agility),
        (-1.0, 0.0, 0.0),
        (0.0, 0.0, RACER.agility / 2),
        (1.0, 0.0, RACER.agility),
    ],
)
def test_throttle(act, throttle, centred, wanted):
    assert thrust(act(ACRO, [0, 0, 0, throttle], centred)) == pytest.approx(wanted, abs=1e-3)


def test_angle_levels_itself_and_leans_where_it_is_told(act):
    level, right, forward = (act(ANGLE, sticks) for sticks in ([0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]))
    np.testing.assert_allclose(level[1:], 0.0, atol=1e-4)
    assert right[1] > 0.3
    assert forward[2] > 0.3
    assert abs(right[2]) < 0.1
    assert act(ANGLE, [0, 0, 1, 0])[3] < -0.9


def test_hold_hovers_whatever_the_sticks_say(act):
    action = act(HOLD, [1, 1, 1, 1])
    np.testing.assert_allclose(action[1:], 0.0, atol=1e-3)
    assert thrust(action) == pytest.approx(RACER.gravity, rel=1e-3)
    assert act(ASSISTED, [0, 1, 0, 0])[2] > 0.05  # leans forward, to the gate
