"""What a vehicle's equations say that a log should hold, for given numbers; docs/vehicles.md has the equations.

All of it is linear in what moves, so that the start of a window, which nobody measured well, can be left free and
eliminated: of rates the two modes of loop and rotors, of velocities a constant.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.signal import lfilter, ss2tf

from cruise.dynamics.rotors import YAW
from cruise.identify.grid import Flight, Samples


class Body(NamedTuple):
    """What is taken as known."""

    mass: float  # [kg]
    inertia: tuple[float, float, float]  # principal moments [kg m^2]
    rotors: tuple[tuple[float, float, float], ...]  # where they are, body frame [m]


class Numbers(NamedTuple):
    """What is to be found."""

    thrust: float  # thrust per mass at full throttle [m/s^2]
    curvature: float  # c(u) = thrust u + curvature u (1 - u) [m/s^2]
    rotor_lag: float  # [s]
    rate_lag: float  # [s]
    delay: float  # [s]
    drift: float  # of the commands' clock [s/s]
    damping: float  # of roll and pitch rates, by the air [1/s]
    yaw_damping: float  # of yaw rates, by the air [1/s]
    horizontal_drag: float  # per mass [1/s]
    vertical_drag: float  # per mass [1/s]
    torque_ratio: float  # [m]


def rate_residuals(flight: Flight, numbers: Numbers) -> Float[ndarray, "3 W S"]:
    """Measured less predicted rates [rad/s], by a rate loop that looks once a step.

    With s the torque per inertia: t_m s' = (w_c - w) / t - s exactly over a step in which w_c and w are held, and
    w' = s - b w with the damping b.
    """
    dt, loop = flight.dt, numbers.rate_lag
    decay = np.exp(-dt / numbers.rotor_lag)
    gain = numbers.rotor_lag * (1 - decay)
    step = np.array([[1.0, gain], [0.0, decay]]) - np.outer([dt - gain, 1 - decay], [1 / loop, 0.0])
    into = np.array([dt - gain, 1 - decay]) / loop
    damped = np.array([np.exp(-numbers.damping * dt), 1.0])
    step, into = damped[:, None] * step, damped * into
    b, a = ss2tf(step, into[:, None], np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    asked = flight.rate_command.mean(flight.edges, numbers.delay, numbers.drift)
    asked = np.concatenate([asked, asked[:, -1:]], axis=1)
    predicted = lfilter(b[0], a, asked, axis=1)
    samples = flight.measured_rates
    return _without_modes(samples.values - _at(flight, predicted, samples), samples, step, dt)


def _without_modes(
    rest: Float[ndarray, "3 W S"], samples: Samples, step: ndarray, dt: float
) -> Float[ndarray, "3 W S"]:
    """What is left after the best start of every window: two modes, the rows of the powers of `step`."""
    since = samples.times - samples.times[:, :1]
    modes = [np.array([1.0, 0.0])]
    for _ in range(int(since.max() / dt) + 2):
        modes.append(modes[-1] @ step)
    steps = dt * np.arange(len(modes))
    shapes = np.array([np.interp(since, steps, mode / np.abs(mode).max()) for mode in np.array(modes).T])
    shapes *= samples.there
    gram = np.einsum("aws,bws->wab", shapes, shapes) + 1e-9 * np.eye(2)
    starts = np.linalg.solve(gram[None], np.einsum("aws,cws->cwa", shapes, rest)[..., None])[..., 0]
    return (rest - np.einsum("cwa,aws->cws", starts, shapes)) * samples.there


def velocity_residuals(flight: Flight, numbers: Numbers, by_speed: bool) -> Float[ndarray, "3 W S"]:
    """Measured less predicted velocity [m/s]: v' = R (c e_z - D R^T v) - g, its start in every window free.

    Where rotors go by speed the drag does too, as blades make it: it is that of hovering times the rotors' speed.
    """
    assert flight.rotation is not None
    assert flight.velocity is not None
    assert flight.measured_velocity is not None
    lift = thrust_per_mass(flight, numbers, by_speed)
    turn, velocity = flight.rotation[:, :, :-1], flight.velocity[:, :-1]
    along = turn[:, 2] * (turn[:, 2] * velocity).sum(axis=0)
    drag = numbers.horizontal_drag * (velocity - along) + numbers.vertical_drag * along
    drag = drag * speed_share(flight, numbers) if by_speed else drag
    pulled = (turn[:, 2] * lift - drag) * flight.dt
    pulled[2] -= flight.gravity * flight.dt
    predicted = np.concatenate([np.zeros((3, 1)), np.cumsum(pulled, axis=1)], axis=1)
    samples = flight.measured_velocity
    return _centred(samples.values - _at(flight, predicted, samples), samples)


def speed_share(flight: Flight, numbers: Numbers) -> Float[ndarray, " K"]:
    """Mean speed of the rotors per that of hovering."""
    if flight.motors is None:
        return np.sqrt(np.maximum(thrust_per_mass(flight, numbers, by_speed=True), 0.0) / flight.gravity)
    each = motor_thrust_per_mass(flight, numbers, by_speed=True)
    return np.mean([np.sqrt(4 * np.maximum(one, 0.0) / flight.gravity) for one in each], axis=0)


def lift_residuals(flight: Flight, numbers: Numbers, by_speed: bool) -> Float[ndarray, "1 W S"]:
    """Measured less predicted specific force along the thrust, where there is no velocity [m/s^2]."""
    lift = thrust_per_mass(flight, numbers, by_speed)
    samples = flight.acceleration
    assert samples is not None
    predicted = _at(flight, np.concatenate([lift, lift[-1:]])[None], samples)
    return (samples.values[2:] - predicted) * samples.there


def yaw_residuals(flight: Flight, numbers: Numbers, by_speed: bool, body: Body) -> Float[ndarray, "1 W S"]:
    """Measured less predicted yaw rate [rad/s]: J_z r' = kappa sum of +- f - (J_y - J_x) p q - J_z b r."""
    each = motor_thrust_per_mass(flight, numbers, by_speed)
    turned = sum(sign * thrust for sign, thrust in zip(YAW, each, strict=True))
    (jx, jy, jz), (p, q, r) = body.inertia, flight.rates[:, :-1]
    pulled = (numbers.torque_ratio * body.mass * turned - (jy - jx) * p * q) / jz - numbers.yaw_damping * r
    if by_speed and flight.rotation is not None and flight.velocity is not None:
        pulled = pulled + body.mass / jz * _yaw_of_drag(flight, numbers, body, each)
    predicted = np.concatenate([[0.0], np.cumsum(pulled) * flight.dt])
    samples = flight.measured_rates
    return _centred(samples.values[2:] - _at(flight, predicted[None], samples), samples)


def _yaw_of_drag(flight: Flight, numbers: Numbers, body: Body, each: list[ndarray]) -> Float[ndarray, " K"]:
    """Torque about z per mass of the drags of single rotors, which are as strong as each turns fast [m^2/s^2].

    Of a rotor at (x, y) with the share s of hovering's speed it is -(x v_y - y v_x) s D / 4. What turning adds to the
    velocity of a rotor is in the damping of yaw.
    """
    assert flight.rotation is not None
    assert flight.velocity is not None
    ahead, left = np.einsum("wbn,wn->bn", flight.rotation[:, :2, :-1], flight.velocity[:, :-1])
    shares = [np.sqrt(4 * np.maximum(thrust, 0.0) / flight.gravity) for thrust in each]
    arms = sum(share * (x * left - y * ahead) for share, (x, y, _) in zip(shares, body.rotors, strict=True))
    return np.asarray(-numbers.horizontal_drag / 4 * arms)


def thrust_per_mass(flight: Flight, numbers: Numbers, by_speed: bool) -> Float[ndarray, " K"]:
    """Collective thrust per mass over every step [m/s^2], from the motors' commands where they are logged."""
    if flight.motors is not None:
        return np.sum(motor_thrust_per_mass(flight, numbers, by_speed), axis=0)
    asked = flight.throttle.mean(flight.edges, numbers.delay, numbers.drift)[0]
    return _lagged(thrust_map(numbers, asked), numbers.rotor_lag, flight.dt, by_speed)


def motor_thrust_per_mass(flight: Flight, numbers: Numbers, by_speed: bool) -> list[Float[ndarray, " K"]]:
    """Of each rotor, whose command acts at once."""
    assert flight.motors is not None
    asked = flight.motors.mean(flight.edges, 0.0, numbers.drift)
    return [_lagged(thrust_map(numbers, one) / 4, numbers.rotor_lag, flight.dt, by_speed) for one in asked]


def thrust_map(numbers: Numbers, throttle: ndarray) -> ndarray:
    """Thrust per mass that a throttle asks for [m/s^2]."""
    return numbers.thrust * throttle + numbers.curvature * throttle * (1 - throttle)


def _lagged(asked: ndarray, lag: float, dt: float, by_speed: bool) -> ndarray:
    """Mean over every step of what follows with a first-order lag: the thrust, or the rotors' speed, its root."""
    if by_speed:
        return _lagged(np.sqrt(np.maximum(asked, 0.0)), lag, dt, by_speed=False) ** 2
    decay = np.exp(-dt / lag)
    ends, _ = lfilter([1 - decay], [1.0, -decay], asked, zi=[decay * asked[0]])
    starts = np.concatenate([asked[:1], ends[:-1]])
    return asked + (starts - asked) * lag / dt * (1 - decay)


def _at(flight: Flight, signals: Float[ndarray, "C N"], samples: Samples) -> Float[ndarray, "C W S"]:
    return np.array([np.interp(samples.times, flight.edges, signal) for signal in signals])


def _centred(rest: Float[ndarray, "C W S"], samples: Samples) -> Float[ndarray, "C W S"]:
    """Without the mean of every window."""
    count = np.maximum(samples.there.sum(axis=1), 1.0)
    mean = (rest * samples.there).sum(axis=2) / count
    return (rest - mean[..., None]) * samples.there
