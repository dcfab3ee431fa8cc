"""What a companion computer says to a flight controller, and hears from it."""

from typing import NamedTuple, Protocol, runtime_checkable

from cruise.dynamics.attitude import Setpoint


class Heard(NamedTuple):
    """What the flight controller said of itself."""

    time: float  # when it came [s]
    armed: bool  # by a person: nothing here can arm
    engaged: bool  # the person has handed the sticks over


@runtime_checkable
class Link(Protocol):
    """A way to a flight controller. Every method is quick and raises LinkLost where the controller is not there."""

    def poll(self, now: float) -> Heard | None:
        """What it said last; None: nothing yet. Asks it again."""

    def command(self, asked: Setpoint, yaw_rate: float, armed: bool) -> None:
        """Fly so; `yaw_rate` is measured [rad/s]. It stays armed as it is, and only while `armed` is so."""

    def stand_by(self) -> None:
        """Say that nothing is commanded, nor armed: what was said before must not count when sticks are handed over."""

    def disarm(self) -> None:
        """Stop the motors, at once."""

    def close(self) -> None:
        """Let go."""


class LinkLost(Exception):
    """The flight controller cannot be reached."""
