"""The flights of many firmware processes, one a drone, side by side."""

import contextlib
import itertools
import logging
import weakref
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from cruise.errors import CruiseError
from cruise.interop.betaflight.configure import Configured
from cruise.interop.betaflight.process import Process, motors_of, requests, talk

DT = 1e-3  # between two looks at the gyro [s]
BEFORE = 1e-2  # likewise while nothing moves yet [s]
RECEIVER, BOOT, ARMING, HOVER = 1.0, 2.0, 0.3, 1.0  # of the firmware's life before a flight [s]
ARMED, DISARMED = 2000, 1000
LOW = (1500, 1500, 988, 1500)
IN_OUR_ORDER = [3, 1, 0, 2]  # its motors as our rotors: front left, front right, rear right, rear left
FLEETS: "weakref.WeakSet[Fleet]" = weakref.WeakSet()


class Fleet:
    """Firmware for any number of drones: each flight is forked from one that hovers, armed, and goes on by itself."""

    def __init__(self, configured: Configured, hover: tuple[int, int, int, int], gyro_noise: float = 0.0) -> None:
        """Nothing is started yet.

        Args:
            configured: the settings.
            hover: the sticks with which a drone hovers [us].
            gyro_noise: standard deviation of every look at the gyro [rad/s].
        """
        self._configured, self._hover, self._noise = configured, hover, gyro_noise
        self._mother: Process | None = None
        self._flights: dict[int, _Flight] = {}
        self._numbers = itertools.count(1)
        self._rng = np.random.default_rng(0)
        self.fault: CruiseError | None = None
        FLEETS.add(self)

    def advance(self, told: Any) -> Any:
        """The next millisecond of every flight.

        A flight is a line: from a state of its past, as that of a drone that is out and stands still, it is not flown
        again, and its motors stay as they are.

        Args:
            told: rates [rad/s], attitude, lift [m/s^2], sticks (roll, pitch, throttle, yaw) [us], the number of the
                flight and the milliseconds since it began [14, K]. The number 0 begins a new one, and ends those that
                are not among these.

        Returns:
            The numbers, and the motors' commands, 0 to 1, in the order of our rotors [5, K].
        """
        try:
            return self._advance(np.asarray(told, np.float64))
        except CruiseError as fault:
            self.fault = fault
            raise

    def _advance(self, told: np.ndarray) -> np.ndarray:
        numbers = self._numbered(told[12].astype(int).tolist())
        flights = [self._flights[number] for number in numbers]
        goes_on = [k for k, tick in enumerate(told[13].tolist()) if flights[k].tick == tick]
        if goes_on:
            self._fly([flights[k] for k in goes_on], told[:12, goes_on])
        motors = np.array([flight.motors for flight in flights])
        return np.vstack([numbers, motors.T]).astype(np.float32)

    def _numbered(self, numbers: list[int]) -> list[int]:
        """The flights, new ones begun."""
        if 0 in numbers:
            self._end(set(self._flights) - set(numbers))
            numbers = [number or self._begin() for number in numbers]
        if not self._flights.keys() >= set(numbers):
            raise CruiseError("a flight of the firmware betaflight has ended: begin a new one from `init`")
        return numbers

    def _fly(self, flights: "list[_Flight]", told: np.ndarray) -> None:
        rates = told[:3].T
        if self._noise:
            rates = rates + self._noise * self._rng.standard_normal(rates.shape)
        time = np.array([flight.process.time for flight in flights])
        sticks = np.hstack([np.rint(told[8:12].T), np.full((len(flights), 1), ARMED)])
        asked = requests(time, DT, sticks, rates, told[3:7].T, told[7])
        replies = talk([flight.process for flight in flights], asked)
        for flight, motors in zip(flights, motors_of(replies)[:, IN_OUR_ORDER], strict=True):
            flight.process.time += DT
            flight.tick, flight.motors = flight.tick + 1, motors

    def _begin(self) -> int:
        if self._mother is None:
            self._mother = _hovering(self._configured, self._hover)
        if not self._flights:
            self._rng = np.random.default_rng(0)
        number = next(self._numbers)
        self._flights[number] = _Flight(self._mother.fork())
        return number

    def _end(self, numbers: set[int]) -> None:
        for number in numbers:
            self._flights.pop(number).process.close()

    def close(self) -> None:
        """End all of them; the next flight starts anew."""
        self._end(set(self._flights))
        if self._mother is not None:
            self._mother.close()
        self._mother = None


class _Flight:
    """One drone's firmware in flight."""

    def __init__(self, process: Process) -> None:
        self.process, self.tick, self.motors = process, 0, process.motors[IN_OUR_ORDER]


def _hovering(configured: Configured, hover: tuple[int, int, int, int]) -> Process:
    """A firmware that has booted, was armed, and believes that it hovers.

    Raises:
        CruiseError: it does not arm.
    """
    process = Process.start(configured.folder)
    for _ in range(round(RECEIVER / BEFORE)):
        process.run(BEFORE)  # sticks that come before its receiver is up are lost for good
    for four, switch, seconds in ((LOW, DISARMED, BOOT), (LOW, ARMED, ARMING), (hover, ARMED, HOVER)):
        for _ in range(round(seconds / BEFORE)):
            process.run(BEFORE, (*four, switch))
    if max(process.motors) <= 0.01:
        process.close()
        raise CruiseError("the firmware betaflight did not arm: its settings forbid it")
    return process


@contextlib.contextmanager
def flights() -> Iterator[None]:
    """A time at whose end every firmware process is ended, and whose fault is told in one line."""
    log = logging.getLogger("jax._src.callback")  # it prints what a callback raises, with its traceback
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    except (jax.errors.JaxRuntimeError, ValueError):  # as what it is raised depends on who calls back
        faults = [fleet.fault for fleet in FLEETS if fleet.fault is not None]
        if faults:
            raise faults[0] from None
        raise
    finally:
        log.setLevel(level)
        for fleet in FLEETS:
            fleet.fault = None
            fleet.close()
