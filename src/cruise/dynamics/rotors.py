"""Four rotors: how their thrusts make a wrench, which wrenches they can make, and which gives way to which."""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Rotors
from cruise.dynamics.algebra import JAX, Algebra
from cruise.dynamics.parameters import Scalar
from cruise.dynamics.quaternion import Component, Three
from cruise.dynamics.rigid_body import Wrench

# Rotors in order: front left, front right, rear right, rear left. Signs with which each one's thrust rolls, pitches
# and, by its reaction torque, yaws the body. The columns are orthogonal, so that the mixer's inverse is its transpose.
ROLL = (1.0, -1.0, -1.0, 1.0)
PITCH = (-1.0, -1.0, 1.0, 1.0)
YAW = (1.0, -1.0, 1.0, -1.0)


def levers(rotors: Rotors) -> tuple[float, float, float]:
    """Torque about x, y and z per newton of one rotor's thrust [m]."""
    forward, sideways = rotors.offset
    return sideways, forward, rotors.torque_ratio


def wrench_of(rotors: Rotors, thrusts: Any, algebra: Algebra = JAX) -> Wrench:
    """What four thrusts [4, *B] N add up to: T = sum f, tau = sum of lever x sign x f (Mahony et al., RAM 2012)."""
    torque = [
        lever * sum(sign * thrusts[i] for i, sign in enumerate(signs))
        for lever, signs in zip(levers(rotors), (ROLL, PITCH, YAW), strict=True)
    ]
    return Wrench(thrusts[0] + thrusts[1] + thrusts[2] + thrusts[3], algebra.stack(torque))


def places(rotors: Rotors) -> list[tuple[float, float, float]]:
    """Where the rotors are in the body's frame [m]."""
    forward, sideways = rotors.offset
    return [(-pitch * forward, roll * sideways, 0.0) for roll, pitch in zip(ROLL, PITCH, strict=True)]


class Demand(NamedTuple):
    """A wrench, component by component."""

    thrust: Component  # [N]
    torque: Three  # [N m]


def rotor_thrusts(rotors: Rotors, wrench: Wrench) -> Float[Array, "4 *B"]:
    """The four thrusts [N] that make a wrench: the inverse of `wrench_of`, without regard to limits."""
    roll, pitch, yaw = wrench.body_torque_b
    return jnp.stack(each_thrust(rotors, Demand(wrench.collective_thrust, (roll, pitch, yaw))))


def each_thrust(rotors: Rotors, demand: Demand) -> list[Any]:
    """The same one by one, for NumPy's arrays as well."""
    shares = [torque / (4 * lever) for torque, lever in zip(demand.torque, levers(rotors), strict=True)]
    collective = demand.thrust / 4
    return [collective + ROLL[i] * shares[0] + PITCH[i] * shares[1] + YAW[i] * shares[2] for i in range(4)]


def scaled(demand: Demand, gain: Scalar) -> Wrench:
    """`gain` times a wrench."""
    roll, pitch, yaw = demand.torque
    return Wrench(gain * demand.thrust, (gain * roll, gain * pitch, gain * yaw))


def saturate(rotors: Rotors, demand: Demand, clip_share: Scalar | None = None, least: Scalar | None = None) -> Demand:
    """The wrench that the rotors make of a demand: itself where every rotor stays within its limits.

    `clip_share` of the way from the cut by priority it is that of `clipped`: what lies between two wrenches that the
    rotors can make, they can make. `least` is in place of the rotors' own least thrust [N].
    """
    if not rotors.saturate:
        return demand
    low = rotors.min_thrust if least is None else least
    cut = by_priority(rotors, demand, low)
    if clip_share is None:
        return cut
    return jax.tree.map(lambda a, b: a + clip_share * (b - a), cut, clipped(rotors, demand, low))


def clipped(rotors: Rotors, demand: Demand, low: Scalar) -> Demand:
    """The wrench of a demand whose thrusts are cut rotor by rotor, not below `low` [N]."""
    return _made(rotors, [jnp.clip(one, low, rotors.max_thrust) for one in each_thrust(rotors, demand)])


def curved(rotors: Rotors, demand: Demand, curve: Scalar) -> Demand:
    """The wrench of rotors that are told the thrusts of a demand, f = u f_max, and give f_max ((1 - c) u + c u^2).

    A propeller's thrust goes with the square of its speed; c is how far a command says that speed, and not thrust.
    """
    if isinstance(curve, float | int) and curve == 0:
        return demand
    return _made(
        rotors, [one * (1 - curve + curve * jnp.abs(one) / rotors.max_thrust) for one in each_thrust(rotors, demand)]
    )


def _made(rotors: Rotors, thrusts: list[Any]) -> Demand:
    wrench = wrench_of(rotors, jnp.stack(thrusts))
    return Demand(wrench.collective_thrust, tuple(wrench.body_torque_b))


def by_priority(rotors: Rotors, demand: Demand, low: Scalar) -> Demand:
    """The wrench of a demand that gives way where it points the thrust least.

    Roll and pitch come first, because they point the thrust; then the collective thrust, which gives way as
    far as they need; then yaw, which takes what is left. So do Faessler, Falanga and Scaramuzza (Thrust Mixing,
    Saturation, and Body-Rate Control for Accurate Aggressive Quadrotor Flight, RA-L 2017), whose iterations are closed
    form here: with a the amplitude of roll and pitch on rotors 1 and 3, b that on 2 and 4, c the collective thrust per
    rotor and y the share of yaw, the thrusts are c +- a + y and c +- b - y.
    """
    high = rotors.max_thrust
    roll, pitch, yaw = (torque / (4 * lever) for torque, lever in zip(demand.torque, levers(rotors), strict=True))
    a, b = jnp.abs(roll - pitch), jnp.abs(roll + pitch)
    share = jnp.minimum(1.0, (high - low) / 2 / jnp.maximum(jnp.maximum(a, b), 1e-12))
    a, b = a * share, b * share
    c = jnp.clip(demand.thrust / 4, low + (a + b) / 2, high - (a + b) / 2)
    least = jnp.maximum(low - c + a, c + b - high)
    most = jnp.minimum(high - c - a, c - b - low)
    torque = (share * demand.torque[0], share * demand.torque[1], 4 * rotors.torque_ratio * jnp.clip(yaw, least, most))
    return Demand(4 * c, torque)


class Lag(NamedTuple):
    """A first-order lag over one sub-step, solved exactly for a demand that is held."""

    kept: Scalar  # share of the difference from the demand that is left at the end
    mean: Scalar  # share of it that there is on average


def lag_over(step: float, time_constant: Scalar) -> Lag:
    """Of f' = (f_demand - f) / tau: f - f_demand falls by exp(-step / tau); tau = 0: at once."""
    if isinstance(time_constant, float | int):
        if time_constant <= 0:
            return Lag(0.0, 0.0)
        kept = math.exp(-step / time_constant)
        return Lag(kept, (1 - kept) * time_constant / step)
    tau = jnp.maximum(time_constant, 1e-6)
    decay = jnp.exp(-step / tau)
    return Lag(decay, (1 - decay) * tau / step)


def follow(lag: Lag, wrench: Demand, demand: Demand) -> tuple[Demand, Demand]:
    """The mean wrench of a sub-step and that at its end.

    All rotors lag alike and a wrench is linear in their thrusts, so the wrench lags as they do; and what lies between
    two wrenches that the rotors can make, they can make.
    """

    def between(now: Component, wanted: Component, share: Scalar) -> Component:
        return wanted + (now - wanted) * share

    def at(share: Scalar) -> Demand:
        roll, pitch, yaw = (between(n, w, share) for n, w in zip(wrench.torque, demand.torque, strict=True))
        return Demand(between(wrench.thrust, demand.thrust, share), (roll, pitch, yaw))

    return at(lag.mean), at(lag.kept)
