"""The companion in real time: a step every control period, and a watchdog beside it."""

import threading
import time

from cruise.companion.flight import Companion
from cruise.companion.link import LinkLost
from cruise.companion.odometry import Receiver
from cruise.errors import CruiseError

WATCH = 0.01  # between two looks of the watchdog [s]
LONGEST = 0.1  # between two steps of the loop in flight [s]
AFTERWARDS = 1.0  # for which an ended flight is kept ended [s]


class Watchdog(threading.Thread):
    """Stops the motors where the loop does not come round in time."""

    def __init__(self, companion: Companion) -> None:
        """Not yet watching."""
        super().__init__(daemon=True)
        self._companion, self._fed, self._over = companion, time.monotonic(), threading.Event()

    def feed(self) -> None:
        """The loop has come round."""
        self._fed = time.monotonic()

    def over(self) -> None:
        """Watch no longer."""
        self._over.set()

    def run(self) -> None:
        """Look, until it is over."""
        while not self._over.wait(WATCH):
            late = time.monotonic() - self._fed
            if self._companion.flying and late > LONGEST:
                try:
                    self._companion.stop(f"the program did not answer for {1000 * late:.0f} ms")
                except LinkLost as error:
                    self._companion.ended = f"the flight controller is lost: {error}"


def run(companion: Companion, receiver: Receiver) -> str:
    """Fly until the flight ends, and say why it did. Ctrl-C ends it.

    Raises:
        CruiseError: the flight controller cannot be reached before there was a flight.
    """
    watchdog = Watchdog(companion)
    watchdog.start()
    try:
        _loop(companion, receiver, watchdog)
    except KeyboardInterrupt:
        companion.stop("Ctrl-C")
    except LinkLost as error:
        if not companion.samples:
            raise CruiseError(f"the flight controller cannot be reached: {error}") from None
        companion.ended, companion.flying = f"the flight controller is lost: {error}", False
    finally:
        watchdog.over()
        companion.link.close()
        receiver.close()
    return companion.ended


def _loop(companion: Companion, receiver: Receiver, watchdog: Watchdog) -> None:
    """A step every control period until `AFTERWARDS` the end."""
    due = time.monotonic()
    end: float | None = None
    while end is None or time.monotonic() < end:
        watchdog.feed()
        companion.step(receiver.poll(time.monotonic()))
        if companion.ended and end is None:
            end = time.monotonic() + AFTERWARDS
        due = max(due + companion.policy.control_dt, time.monotonic())
        time.sleep(max(due - time.monotonic(), 0.0))
