"""What CRUISE is compared with does the work that it is said to do."""

import sys

import gymnasium.utils.env_checker
import numpy as np
import pytest

from benchmarks.peers.__main__ import OURS, compare
from benchmarks.peers.apart import Apart
from benchmarks.peers.cases import PlainEnvironment
from benchmarks.peers.plain_race import PlainRace


class Work:
    def __init__(self, work):
        self.work = work

    def __call__(self):
        pass


def test_the_plain_race_is_an_environment():
    gymnasium.utils.env_checker.check_env(PlainRace(drones=3), skip_render_check=True)


def test_the_plain_race_is_flown_and_rewarded():
    """Through the first gate at 2 m/s: the step that ends at its plane is worth 1, then the next gate is the target."""
    race = PlainRace(drones=1)
    race.reset(seed=1)
    first = race.target[0]
    gate = race.track.gates[first]
    forward = np.array([np.cos(gate.yaw), np.sin(gate.yaw), 0.0])
    race.fleet[0].position[:] = gate.position_w - 0.5 * forward
    race.fleet[0].velocity[:] = 2.0 * forward
    rewards = [race.step(np.zeros(3))[1] for _ in range(2)]
    assert rewards[0] < 0.0
    assert rewards[1] == 1.0
    assert race.target[0] == (first + 1) % len(race.track.gates)


def test_a_drone_that_leaves_or_hits_another_is_out():
    race = PlainRace(drones=2)
    race.reset(seed=2)
    race.fleet[0].position[:] = race.fleet[1].position + 0.2
    assert race.step(np.zeros(3))[1:3] == (-1.0, True)
    race.reset(seed=3)
    race.fleet[0].position[:] = 50.0
    assert race.step(np.zeros(3))[1:3] == (-1.0, True)


def test_what_is_not_installed_is_named_and_left_out(capsys):
    def missing():
        raise ModuleNotFoundError("no", name="some_library")

    rows = compare({OURS: lambda: Work(10.0), "theirs": lambda: Work(1.0), "absent": missing}, rounds=3)
    assert capsys.readouterr().out == "left out: absent (some_library is not installed)\n"
    assert [row["who"] for row in rows] == [OURS, "theirs"]
    assert rows[0]["ours_is_faster"] == pytest.approx(1.0)


def test_a_case_in_another_process_is_built_and_called():
    case = Apart(sys.executable, "benchmarks.peers.cases:PlainEnvironment")
    assert case.work == PlainEnvironment().work
    for _ in range(2):
        case()
        assert case.used > 0


@pytest.mark.parametrize(("python", "missing"), [(sys.executable, "nowhere"), ("/no/such/python", "/no/such/python")])
def test_what_is_missing_in_another_process_is_named(python, missing):
    with pytest.raises(ModuleNotFoundError) as raised:
        Apart(python, "nowhere.at_all:case")
    assert raised.value.name == missing


def test_a_case_that_breaks_in_another_process_is_no_endless_wait():
    with pytest.raises(RuntimeError, match="ended with exit code 1"):
        Apart(sys.executable, "benchmarks.peers.cases:no_such_case")
