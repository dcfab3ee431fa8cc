"""What a pilot may say to a vehicle: the numbers of an action, declared once. Plain Python: no JAX.

An action is as many numbers in [-1, 1]; what -1 and 1 mean is said here, and spaces, exported ports, tables in docs
and `cruise vehicles show` follow from it.
"""

from dataclasses import dataclass
from typing import Literal

Control = Literal["acceleration", "velocity", "position", "ctbr", "attitude"]
ActionFrame = Literal["world", "body"]
YawControl = Literal["rate", "angle"]


@dataclass(frozen=True)
class Number:
    """One number of an action: -1 stands for `low`, 1 for `high`, and what lies between is linear."""

    name: str
    unit: str
    low: float
    high: float
    meaning: str

    def share(self, value: float) -> float:
        """The number in [-1, 1] that stands for a value in `unit`."""
        return 2 * (value - self.low) / (self.high - self.low) - 1


@dataclass(frozen=True)
class Action:
    """What a vehicle is told at every control step."""

    kind: Control
    numbers: tuple[Number, ...]
    frame: ActionFrame  # world: three components of one vector, z up; body: the drone's own, no direction of the world
    neutral: tuple[float, ...]  # hovers, of a drone that stands level in the air; in [-1, 1]

    @property
    def size(self) -> int:
        """How many numbers."""
        return len(self.numbers)


def _vector(kind: Control, quantity: str, unit: str, highest: float, meaning: str) -> Action:
    numbers = tuple(Number(f"{quantity}_{axis}", unit, -highest, highest, f"{meaning} along {axis}") for axis in "xyz")
    return Action(kind, numbers, "world", (0.0, 0.0, 0.0))


def acceleration(agility: float) -> Action:
    """A desired acceleration, `agility` [m/s^2] at most along every axis of the world."""
    return _vector("acceleration", "acceleration", "m/s^2", agility, "desired acceleration")


def velocity(speed: float) -> Action:
    """A velocity to hold, `speed` [m/s] at most along every axis of the world."""
    return _vector("velocity", "velocity", "m/s", speed, "velocity to hold")


def position(reach: float) -> Action:
    """A place to fly to, `reach` [m] at most from the drone along every axis of the world."""
    return _vector("position", "offset", "m", reach, "place to fly to, from the drone")


def _thrust(agility: float) -> Number:
    return Number("collective_thrust", "m/s^2", 0.0, agility, "thrust of all rotors per mass")


def _yaw_rate(highest: float, meaning: str) -> Number:
    return Number("yaw_rate", "rad/s", -highest, highest, meaning)


def ctbr(agility: float, gravity: float, highest_rates: tuple[float, float, float]) -> Action:
    """Collective thrust and body rates: `agility` [m/s^2] is the highest thrust per mass, rates in rad/s."""
    roll, pitch, yaw = highest_rates
    numbers = (
        _thrust(agility),
        Number("roll_rate", "rad/s", -roll, roll, "about the body's x axis, forward"),
        Number("pitch_rate", "rad/s", -pitch, pitch, "about the body's y axis, left"),
        _yaw_rate(yaw, "about the body's z axis, up"),
    )
    return Action("ctbr", numbers, "body", (hovering_share(agility, gravity), 0.0, 0.0, 0.0))


def attitude(agility: float, gravity: float, highest_tilt: float, yaw: YawControl, highest_turn: float) -> Action:
    """Roll, pitch, yaw or yaw rate, and collective thrust; roll and pitch are those of ZYX Euler angles [rad].

    `highest_turn` is of what is said of yaw: [rad] or [rad/s].
    """
    if yaw == "angle":
        turn = Number("yaw", "rad", -highest_turn, highest_turn, "heading of the body's x axis, 0 along the world's x")
    else:
        turn = _yaw_rate(highest_turn, "about the world's z axis")
    numbers = (
        Number("roll", "rad", -highest_tilt, highest_tilt, "positive leans right"),
        Number("pitch", "rad", -highest_tilt, highest_tilt, "positive leans forward"),
        turn,
        _thrust(agility),
    )
    return Action("attitude", numbers, "body", (0.0, 0.0, 0.0, hovering_share(agility, gravity)))


def hovering_share(agility: float, gravity: float) -> float:
    """The number for collective thrust that carries the weight of a level drone."""
    return 2 * gravity / agility - 1
