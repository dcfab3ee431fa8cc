"""One flight of a policy aboard a drone: what is asked of the flight controller, and when it must end."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from cruise.companion.link import Heard, Link
from cruise.companion.odometry import Odometry
from cruise.dynamics.attitude import Setpoint

Vector = tuple[float, float, float]


@runtime_checkable
class Aboard(Protocol):
    """What flies: `cruise.companion.policy.OnnxPolicy`, or one of your own."""

    control_dt: float  # [s]
    next_gate: int

    def act(self, state: Odometry) -> tuple[np.ndarray, Setpoint]:
        """The action in [-1, 1] [4], and what it asks of the flight controller."""


@dataclass(frozen=True)
class Limits:
    """What ends a flight. Times count from the moment that a state was measured."""

    low: Vector  # lowest corner of the geofence [m]
    high: Vector  # highest corner [m]
    oldest: float = 0.1  # age of a state, or of what the flight controller said [s]
    fastest: float = 30.0  # speed [m/s]
    jump: float = 1.0  # how far a position may be from where the velocity led [m]
    thinking: float = 0.05  # time for one action [s]


class Sample(NamedTuple):
    """What is kept of one control step."""

    time: float  # [s]
    state: Odometry
    action: np.ndarray  # [4] in [-1, 1]
    next_gate: int


class Companion:
    """The loop, a step at a time: it waits for a person to arm and to hand over, flies, and ends once for all.

    Nothing here arms. A fault in flight stops the motors: a racing drone that does not know where it is, is safest
    falling; so does handing over to a companion that is at fault. A person who takes the sticks back or disarms ends
    the flight as well.
    """

    def __init__(self, policy: Aboard, link: Link, limits: Limits, clock: Callable[[], float]) -> None:
        """Everything is at hand, and nothing was said yet; `clock` gives the time now [s]."""
        self.policy, self.link, self.limits, self._clock = policy, link, limits, clock
        self.flying = False
        self.ended = ""  # why, once it has
        self.samples: list[Sample] = []
        self._heard: Heard | None = None
        self._state: Odometry | None = None

    def step(self, state: Odometry | None) -> None:
        """One control step with the newest state there is. Raises LinkLost where nothing can be said any more.

        From arming on it commands, so that what the person hands over to is there already, and fresh.
        """
        now = self._clock()
        heard = self._heard = self.link.poll(now)
        engaged = heard is not None and heard.armed and heard.engaged
        if self.flying and not engaged:
            self._end("a person took over", disarm=False)
        fault = "not armed" if heard is None or not heard.armed else self.ended or self.fault(now, state)
        if not fault:
            assert state is not None
            self._fly(now, state, engaged)
        elif engaged:
            self._end(self.ended or fault)
        else:
            self._state = None
            self.link.stand_by()

    def fault(self, now: float, state: Odometry | None) -> str:
        """Why it must not fly on; empty where it may."""
        limits, before = self.limits, self._state
        if state is None:
            return "no odometry has come"
        if not now - state.time <= limits.oldest:
            return f"the odometry is {1000 * (now - state.time):.0f} ms old"
        if self._heard is not None and not now - self._heard.time <= limits.oldest:
            return f"the flight controller has said nothing for {1000 * (now - self._heard.time):.0f} ms"
        sides = zip("xyz", limits.low, state.position_w, limits.high, strict=True)
        beyond = [axis for axis, low, at, high in sides if not low <= at <= high]
        if beyond:
            return f"left the geofence along {beyond[0]}"
        if not np.linalg.norm(state.velocity_w) <= limits.fastest:
            return f"faster than {limits.fastest:g} m/s"
        if before is not None and state.time > before.time:
            passed = state.time - before.time
            led = before.position_w + passed * (before.velocity_w + state.velocity_w) / 2
            if not np.linalg.norm(state.position_w - led) <= limits.jump:
                return "the odometry jumps"
        return ""

    def stop(self, reason: str) -> None:
        """End from outside: a watchdog, Ctrl-C."""
        if not self.ended:
            self._end(reason, disarm=self.flying)

    def _fly(self, now: float, state: Odometry, engaged: bool) -> None:
        action, asked = self.policy.act(state)
        late = self._clock()
        fault = ""
        if not all(math.isfinite(one) for one in (asked.thrust, *asked.rates_b)):
            fault = "the policy gives what is no number"
        elif late - now > self.limits.thinking:
            fault = f"the policy took {1000 * (late - now):.0f} ms"
        elif late - state.time > self.limits.oldest:
            fault = f"the odometry is {1000 * (late - state.time):.0f} ms old"
        if fault or self.ended:  # by a watchdog meanwhile
            self._end(fault)
            return
        self.link.command(asked, float(state.angular_velocity_b[2]), armed=True)
        self.flying, self._state = engaged, state
        if engaged:
            self.samples.append(Sample(now, state, action, self.policy.next_gate))

    def _end(self, reason: str, disarm: bool = True) -> None:
        self.ended, self.flying = self.ended or reason, False
        if disarm:
            self.link.disarm()
