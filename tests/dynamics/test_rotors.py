"""The mixer, its limits and its priorities, and the rotors' lag."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Rotors
from cruise.dynamics.rigid_body import Wrench
from cruise.dynamics.rotors import Demand, clipped, curved, follow, lag_over, rotor_thrusts, saturate, wrench_of

ROTORS = Rotors(offset=(0.075, 0.1), torque_ratio=0.022, max_thrust=6.0, min_thrust=0.2, time_constant=0.033)
PLACES = np.array([[0.075, 0.1], [0.075, -0.1], [-0.075, -0.1], [-0.075, 0.1]])  # front left, then clockwise
SPIN = np.array([1, -1, 1, -1])  # reaction torque of each about z


@pytest.fixture(autouse=True)
def float64() -> Iterator[None]:
    with jax.enable_x64(True):
        yield


def mixer() -> np.ndarray:
    """T = sum f, tau = sum r x f e_z + spin kappa f e_z, rotor by rotor: [4 wrench, 4 rotors]."""
    forces = np.array([[0, 0, 1.0]] * 4)
    arms = np.concatenate([PLACES, np.zeros((4, 1))], axis=1)
    torques = np.cross(arms, forces) + (0.022 * SPIN)[:, None] * forces
    return np.concatenate([np.ones((1, 4)), torques.T])


def thrusts_of(demand: Demand) -> np.ndarray:
    return np.asarray(rotor_thrusts(ROTORS, Wrench(demand.thrust, jnp.stack(list(demand.torque)))))


def demand_of(wrench: np.ndarray) -> Demand:
    thrust, *torque = jnp.asarray(wrench)
    return Demand(thrust, tuple(torque))


def wrench_from(demand: Demand) -> np.ndarray:
    return np.stack([np.asarray(demand.thrust), *(np.asarray(t) for t in demand.torque)])


def random_thrusts(low: float, high: float, count: int = 2000) -> np.ndarray:
    return np.random.default_rng(0).uniform(low, high, (4, count))


def test_the_wrench_is_the_sum_over_the_rotors() -> None:
    thrusts = random_thrusts(-1, 8)
    wrench = wrench_of(ROTORS, jnp.asarray(thrusts))
    got = np.concatenate([np.asarray(wrench.collective_thrust)[None], np.asarray(wrench.body_torque_b)])
    np.testing.assert_allclose(got, mixer() @ thrusts, atol=1e-12)


def test_the_mixers_inverse_is_exact() -> None:
    thrusts = random_thrusts(-1, 8)
    np.testing.assert_allclose(rotor_thrusts(ROTORS, wrench_of(ROTORS, jnp.asarray(thrusts))), thrusts, atol=1e-12)


def test_what_the_rotors_can_do_is_done_exactly() -> None:
    wrench = mixer() @ random_thrusts(ROTORS.min_thrust, ROTORS.max_thrust)
    np.testing.assert_allclose(wrench_from(saturate(ROTORS, demand_of(wrench))), wrench, atol=1e-12)


def test_no_rotor_ever_leaves_its_limits() -> None:
    thrusts = thrusts_of(saturate(ROTORS, demand_of(mixer() @ random_thrusts(-30, 40))))
    assert thrusts.min() >= ROTORS.min_thrust - 1e-12
    assert thrusts.max() <= ROTORS.max_thrust + 1e-12
    assert (np.abs(thrusts - ROTORS.max_thrust) < 1e-9).any()


def test_a_cut_rotor_by_rotor_is_that_of_every_thrust_alone() -> None:
    wild = random_thrusts(-30, 40)
    found = thrusts_of(clipped(ROTORS, demand_of(mixer() @ wild), ROTORS.min_thrust))
    np.testing.assert_allclose(found, wild.clip(ROTORS.min_thrust, ROTORS.max_thrust), atol=1e-12)


def test_a_share_of_it_lies_between_the_two_cuts_and_within_the_limits() -> None:
    demand = demand_of(mixer() @ random_thrusts(-30, 40))
    by_priority, by_rotor = (saturate(ROTORS, demand, share) for share in (None, 1.0))
    np.testing.assert_allclose(
        wrench_from(by_rotor), wrench_from(clipped(ROTORS, demand, ROTORS.min_thrust)), atol=1e-12
    )
    assert np.abs(wrench_from(by_priority) - wrench_from(by_rotor)).max() > 0.1
    quarter = wrench_from(saturate(ROTORS, demand, 0.25))
    np.testing.assert_allclose(quarter, 0.75 * wrench_from(by_priority) + 0.25 * wrench_from(by_rotor), atol=1e-12)
    thrusts = thrusts_of(demand_of(quarter))
    assert thrusts.min() >= ROTORS.min_thrust - 1e-12
    assert thrusts.max() <= ROTORS.max_thrust + 1e-12


def test_what_the_rotors_can_do_is_not_cut_in_either_way() -> None:
    wrench = mixer() @ random_thrusts(ROTORS.min_thrust, ROTORS.max_thrust)
    np.testing.assert_allclose(wrench_from(saturate(ROTORS, demand_of(wrench), 0.5)), wrench, atol=1e-12)


def yaw_room(trial: np.ndarray) -> tuple[float, float]:
    """Yaw torques, least and most, with which every rotor stays within its limits; least > most where there is none."""
    inverse = np.linalg.inv(mixer())
    without, per_yaw = inverse @ (trial * [1, 1, 1, 0]), inverse[:, 3]
    ends = (np.array([[ROTORS.min_thrust], [ROTORS.max_thrust]]) - without) / per_yaw
    return ends.min(axis=0).max(), ends.max(axis=0).min()


def furthest(good: float, wanted: float, fits: Callable[[float], bool]) -> float:
    """The value nearest to `wanted` that fits, on the way from one that does, by bisection."""
    if fits(wanted):
        return wanted
    for _ in range(50):
        middle = (good + wanted) / 2
        good, wanted = (middle, wanted) if fits(middle) else (good, middle)
    return good


def reference(wrench: np.ndarray) -> np.ndarray:
    """The same priorities for one wrench, by trying: every stage as near to its demand as can be, whatever follows."""
    thrust, roll, pitch, yaw = wrench

    def fits(*trial: float, slack: float = 1e-10) -> bool:
        low, high = yaw_room(np.array([*trial, 0.0]))
        return low <= high + slack

    middle = 2 * (ROTORS.min_thrust + ROTORS.max_thrust)
    share = furthest(0.0, 1.0, lambda s: fits(middle, s * roll, s * pitch, slack=0.0))
    roll, pitch = share * roll, share * pitch
    thrust = furthest(middle, thrust, lambda t: fits(t, roll, pitch))
    return np.array([thrust, roll, pitch, np.clip(yaw, *yaw_room(np.array([thrust, roll, pitch, 0])))])


def test_roll_and_pitch_go_before_thrust_and_thrust_before_yaw() -> None:
    wrench = mixer() @ random_thrusts(-6, 12, count=60)
    expected = np.stack([reference(w) for w in wrench.T], axis=1)
    changed = np.abs(expected - wrench) > 0.01 * np.abs(wrench).max(axis=1, keepdims=True)
    assert changed.any(axis=1).all()  # each of the four gives way somewhere
    np.testing.assert_allclose(wrench_from(saturate(ROTORS, demand_of(wrench))), expected, atol=1e-8)


def test_another_idle_is_that_of_rotors_that_have_it() -> None:
    demand = demand_of(mixer() @ random_thrusts(-30, 40))
    other = replace(ROTORS, min_thrust=1.5 * ROTORS.min_thrust)
    for share in (None, 0.3):
        found, wanted = (saturate(ROTORS, demand, share, other.min_thrust), saturate(other, demand, share))
        np.testing.assert_allclose(wrench_from(found), wrench_from(wanted), atol=1e-12)


def test_a_curve_is_that_of_every_rotor_alone() -> None:
    told = random_thrusts(0, ROTORS.max_thrust)
    found = thrusts_of(curved(ROTORS, demand_of(mixer() @ told), 0.4))
    np.testing.assert_allclose(found, 0.6 * told + 0.4 * told**2 / ROTORS.max_thrust, atol=1e-12)
    demand = demand_of(mixer() @ told)
    assert curved(ROTORS, demand, 0.0) is demand


def test_saturation_can_be_switched_off() -> None:
    wild = demand_of(mixer() @ random_thrusts(-30, 40))
    np.testing.assert_array_equal(wrench_from(saturate(replace(ROTORS, saturate=False), wild)), wrench_from(wild))


@pytest.mark.parametrize("traced", [False, True])
def test_the_lag_is_the_exponential(traced: bool) -> None:
    """A held demand is approached by exp(-t / tau), however the time is cut, and the mean is the exponential's."""
    tau, step, count = 0.033, 0.004, 25
    start, demand = demand_of(np.array([4.0, 0.1, -0.2, 0.05])), demand_of(np.array([9.0, -0.1, 0.3, 0.0]))
    lag = lag_over(step, jnp.asarray(tau) if traced else tau)
    now, means = start, []
    for _ in range(count):
        mean, now = follow(lag, now, demand)
        means.append(wrench_from(mean))
    left = np.exp(-count * step / tau)
    expected = wrench_from(demand) + (wrench_from(start) - wrench_from(demand)) * left
    np.testing.assert_allclose(wrench_from(now), expected, atol=1e-12)
    share = tau / (count * step) * (1 - left)
    expected = wrench_from(demand) + (wrench_from(start) - wrench_from(demand)) * share
    np.testing.assert_allclose(np.mean(means, axis=0), expected, atol=1e-12)


def test_without_a_time_constant_rotors_follow_at_once() -> None:
    start, demand = demand_of(np.zeros(4)), demand_of(np.array([9.0, -0.1, 0.3, 0.1]))
    for wrench in follow(lag_over(0.004, 0.0), start, demand):
        np.testing.assert_array_equal(wrench_from(wrench), wrench_from(demand))
    mean, end = follow(lag_over(0.004, jnp.asarray(0.0)), start, demand)
    np.testing.assert_allclose(wrench_from(end), wrench_from(demand), atol=1e-12)
    np.testing.assert_allclose(wrench_from(mean), wrench_from(demand), rtol=1e-3)
