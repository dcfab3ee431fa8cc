"""What a policy asks for, as sticks: the way that a companion computer goes, too. NumPy, JAX or plain numbers."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from cruise.config import Vehicle
from cruise.dynamics.attitude import Setpoint
from cruise.interop.betaflight.settings import ITERM, PTERM, full_rates, matched_p
from cruise.interop.flight_controller import airframe_of

MIDDLE, REACH, TOP = 1500.0, 500.0, 2000.0  # of a stick [us]


class YawLoop(NamedTuple):
    """What the link remembers of yaw."""

    asked: Any  # the rate that the stick says [rad/s]
    wound: Any  # integral of the firmware's error, as its I term has it [rad]


def not_wound(zero: Any) -> YawLoop:
    """At the start."""
    return YawLoop(zero, zero)


class StickMap(NamedTuple):
    """From thrust and rates to sticks, for one vehicle and what its firmware was set to.

    Yaw is slow, so that the firmware's I term winds up while rotors turn it, and swings back afterwards. The link knows
    the gains, and so that term: with e = s - r the error of the stick s, the firmware's torque is P e + I x, where x is
    the integral of e. It becomes the vehicle's own P_m (r_c - r) by s = r + (P_m (r_c - r) - I x) / P.
    """

    top: float  # thrust per mass of all rotors [m/s^2]
    full: tuple[float, float, float]  # rates at full stick [rad/s]
    idle: float  # of a motor's range, that it turns with at no throttle
    least: float  # the stick at which throttle begins [us]
    gain: float  # P_m / P of yaw
    unwinding: float  # I / P of yaw [1/s]
    most_wound: float  # x at the limit of the I term [rad]

    @classmethod
    def of(cls, vehicle: Vehicle, known: Mapping[str, float]) -> "StickMap":
        """For a vehicle whose firmware is set by `settings.link`; `known` are the settings that count."""
        airframe = airframe_of(vehicle)
        top = 4 * airframe.rotors.max_thrust / vehicle.mass
        p, i = PTERM * max(known["p_yaw"], 1.0), ITERM * known["i_yaw"]
        most = math.radians(known["iterm_windup"] / 100 * known["pidsum_limit_yaw"] / i) if i else 0.0
        gain = PTERM * matched_p(vehicle)[2] / p
        idle = known["motor_idle"] / 10_000
        return cls(top, full_rates(vehicle), idle, known["min_check"], gain, i / p, most)

    def yaw_loop(self, before: YawLoop, wanted: Any, rate: Any, looks: Any) -> YawLoop:
        """The yaw rate to say, where the link looks at the gyro; elsewhere it is held. All in rad/s."""
        stick = rate + self.gain * (wanted - rate) - self.unwinding * before.wound
        stick = _between(stick, -self.full[2], self.full[2])
        return before._replace(asked=looks * stick + (1 - looks) * before.asked)

    def wind(self, yaw: YawLoop, rate: Any, dt: float) -> YawLoop:
        """The I term after `dt` [s] at a yaw rate [rad/s]."""
        wound = _between(yaw.wound + (yaw.asked - rate) * dt, -self.most_wound, self.most_wound)
        return yaw._replace(wound=wound)

    def channels(self, asked: Setpoint) -> tuple[Any, Any, Any, Any]:
        """Roll, pitch, throttle and yaw [us]. The firmware's yaw turns the other way than ours."""
        roll, pitch, yaw = (rate / full for rate, full in zip(asked.rates_b, self.full, strict=True))
        share = (asked.thrust / self.top - self.idle) / (1 - self.idle)
        throttle = self.least + (TOP - self.least) * _between(share, 0.0, 1.0)
        right, forward, about = (MIDDLE + REACH * _between(part, -1.0, 1.0) for part in (roll, pitch, -yaw))
        return right, forward, throttle, about

    def hover(self, gravity: float) -> tuple[int, int, int, int]:
        """The sticks of a drone that stays where it is."""
        roll, pitch, throttle, yaw = self.channels(Setpoint(gravity, (0.0, 0.0, 0.0)))
        return round(roll), round(pitch), round(throttle), round(yaw)


def _between(value: Any, low: float, high: float) -> Any:
    return value.clip(low, high) if hasattr(value, "clip") else min(max(value, low), high)
