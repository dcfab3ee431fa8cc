"""What a page may say, and nothing else: every message is checked before anything is done with it."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cruise.config import Vehicle
from cruise.errors import CruiseError
from cruise.pilots.human import flight_modes

LARGEST = 2048  # of a message [bytes]
HIGHEST_RATE = 2000.0  # [deg/s]
LONGEST_NAME = 24
ANSWER = 1 << 31  # numbers of sticks are below


class Refused(CruiseError):
    """A message that no page of ours sends."""


@dataclass(frozen=True)
class Sticks:
    """Where the sticks are."""

    number: int  # of the message, which the state of the race repeats
    positions: tuple[float, ...]  # roll right, pitch forward, yaw right, throttle up, in [-1, 1]


@dataclass(frozen=True)
class Settings:
    """How the sticks are to be read."""

    mode: str
    rates: tuple[tuple[float, ...], ...]  # of roll, pitch, yaw: at the centre, at full stick [deg/s], expo
    tilt: float  # at full stick in angle mode [deg]
    speed: float  # at full stick in assisted mode [m/s]
    centred: bool  # whether the throttle hovers in its middle
    name: str = ""


@dataclass(frozen=True)
class Ready:
    """Whoever says so wants the next race to begin, even if it ends this one."""


def usual_settings(vehicle: Vehicle) -> Settings:
    """What a newcomer flies a vehicle with."""
    highest = (10.0, 10.0, 3.0) if vehicle.airframe is None else vehicle.airframe.rates.highest
    rates = tuple((min(100.0, most), most, 0.3) for most in (float(round(math.degrees(rate))) for rate in highest))
    speed = round(min(8.0, 0.65 * vehicle.tracking.speed), 1)
    return Settings(flight_modes(vehicle)[0], rates, tilt=50.0, speed=speed, centred=True)


def read_message(text: str | bytes, modes: tuple[str, ...]) -> Sticks | Settings | Ready:
    """What a page says. Raises Refused, with the reason, where it is not one of the three."""
    if not isinstance(text, str):
        raise Refused("not text")
    try:
        content = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError):
        raise Refused("not JSON") from None
    reader = READERS.get(frozenset(content)) if isinstance(content, dict) else None
    if reader is None:
        raise Refused("neither sticks nor settings nor ready")
    return reader(content, modes)


def _no_number(word: str) -> float:
    raise Refused(f"{word} is no number")


def _sticks(content: dict[str, Any], modes: tuple[str, ...]) -> Sticks:
    number = content["n"]
    if type(number) is not int or not 0 <= number < ANSWER:
        raise Refused("sticks without a number")
    return Sticks(number, _numbers(content["sticks"], (-1.0,) * 4, (1.0,) * 4, "sticks"))


def _settings(content: dict[str, Any], modes: tuple[str, ...]) -> Settings:
    told = content["settings"]
    if not isinstance(told, dict) or set(told) != {"mode", "rates", "tilt", "speed", "centred", "name"}:
        raise Refused("settings that are not all there are")
    if told["mode"] not in modes:
        raise Refused("a mode that this vehicle does not have")
    if type(told["centred"]) is not bool:
        raise Refused("a throttle neither centred nor not")
    if not isinstance(told["rates"], list) or len(told["rates"]) != 3:
        raise Refused("not three rates")
    rates = tuple(_numbers(row, (0.0,) * 3, (HIGHEST_RATE, HIGHEST_RATE, 1.0), "rates") for row in told["rates"])
    tilt, speed = _numbers([told["tilt"], told["speed"]], (5.0, 0.5), (80.0, 40.0), "tilt and speed")
    return Settings(told["mode"], rates, tilt, speed, told["centred"], _name(told["name"]))


def _ready(content: dict[str, Any], modes: tuple[str, ...]) -> Ready:
    if content["ready"] is not True:
        raise Refused("ready is true or not said")
    return Ready()


READERS: dict[frozenset[str], Callable[..., Sticks | Settings | Ready]] = {
    frozenset({"n", "sticks"}): _sticks,
    frozenset({"settings"}): _settings,
    frozenset({"ready"}): _ready,
}


def _name(name: Any) -> str:
    if not isinstance(name, str) or len(name) > LONGEST_NAME or not (name == "" or name.isprintable()):
        raise Refused(f"a name is at most {LONGEST_NAME} printable characters")
    return name.strip()


def _numbers(values: Any, low: tuple[float, ...], high: tuple[float, ...], what: str) -> tuple[float, ...]:
    if not isinstance(values, list) or len(values) != len(low) or any(type(v) not in (int, float) for v in values):
        raise Refused(f"{what}: not {len(low)} numbers")
    if not all(bottom <= value <= top for bottom, value, top in zip(low, values, high, strict=True)):
        raise Refused(f"{what}: out of range")
    return tuple(float(value) for value in values)


def rates_of(settings: Settings) -> np.ndarray:
    """[3, 3] as `Controls.rates` has them: axes, then centre and maximum [rad/s], expo."""
    return np.array(settings.rates) * np.array([math.radians(1), math.radians(1), 1.0])
