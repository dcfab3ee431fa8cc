"""A battery that sags: the faster and the longer rotors turn, the less they lift."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Battery, Rotors

AIR_DENSITY = 1.225  # [kg/m^3]


class Supply(NamedTuple):
    """What the battery gives at one moment."""

    voltage: Float[Array, "*B"]  # at the terminals [V]
    current: Float[Array, "*B"]  # [A]
    thrust_share: Float[Array, "*B"]  # of what the rotors would give at full voltage


def ideal_power(rotors: Rotors, thrusts: Float[Array, "4 *B"]) -> Float[Array, "*B"]:
    """Power [W] of ideal hovering rotors: P = sum f^(3/2) / sqrt(2 rho pi r^2) (momentum theory, Leishman 2006)."""
    f = jnp.maximum(thrusts, 0.0)
    powers = f * jnp.sqrt(f) / (2 * AIR_DENSITY * jnp.pi * rotors.radius**2) ** 0.5
    return powers[0] + powers[1] + powers[2] + powers[3]


def supply(battery: Battery, power: Float[Array, "*B"], charge: Float[Array, "*B"]) -> Supply:
    """Voltage V = V_0 - R I under a load of `power` [W] of ideal power, at a `charge` in [0, 1].

    V_0 falls linearly with the charge. With I = P / V the voltage is the greater root of V^2 - V_0 V + R P = 0 (the
    internal-resistance model of He, Xiong and Fan, Energies 2011); the most that the battery can give, V_0^2 / 4 R, is
    given where more is asked. Rotors turn as fast as there are volts, and thrust goes with the square of their speed.
    """
    rest = battery.empty_voltage + (battery.full_voltage - battery.empty_voltage) * charge
    load = power / battery.efficiency
    voltage = (rest + jnp.sqrt(jnp.maximum(rest * rest - 4 * battery.resistance * load, 0.0))) / 2
    current = (rest - voltage) / battery.resistance if battery.resistance > 0 else load / voltage
    return Supply(voltage, current, (voltage / battery.full_voltage) ** 2)


def discharge(battery: Battery, charge: Float[Array, "*B"], current: Float[Array, "*B"], dt: float) -> Array:
    """The charge after `dt` [s]; never below 0."""
    return jnp.maximum(charge - current * dt / battery.capacity, 0.0)
