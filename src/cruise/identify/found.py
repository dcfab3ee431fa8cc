"""What flights tell of a vehicle, and what tells it."""

from dataclasses import dataclass
from typing import NamedTuple


class Kind(NamedTuple):
    """How one number is searched for."""

    step: float  # of a difference
    low: float
    high: float
    manoeuvre: str  # what tells it


LOGGED = "above 5 m/s, with attitude and velocity in the log"
KINDS: dict[str, Kind] = {
    "thrust": Kind(1e-2, 1.0, 500.0, "climb and descend with the throttle between a third and full"),
    "curvature": Kind(1e-2, -200.0, 200.0, "climb and descend with the throttle between a third and full"),
    "rotor_lag": Kind(2e-4, 1e-3, 0.5, "step throttle, roll and pitch rates up and down, several times a second"),
    "rate_lag": Kind(2e-4, 2e-3, 1.0, "step roll and pitch rates up and down, several times a second"),
    "delay": Kind(4e-4, 0.0, 0.3, "step roll and pitch rates up and down, several times a second"),
    "drift": Kind(1e-6, -0.01, 0.01, ""),
    "damping": Kind(5e-3, -20.0, 50.0, ""),
    "yaw_damping": Kind(5e-3, -20.0, 50.0, ""),
    "horizontal_drag": Kind(2e-3, 0.0, 20.0, f"fly level at several speeds {LOGGED}"),
    "vertical_drag": Kind(2e-3, 0.0, 20.0, f"climb and descend at several speeds {LOGGED}"),
    "torque_ratio": Kind(1e-4, -1.0, 1.0, "step the yaw rate up and down, with the four motors in the log"),
}


@dataclass(frozen=True)
class Estimate:
    """A number, its 95 % interval, and whether the flights tell it; if not it is that of the vehicle to start from."""

    value: float
    low: float
    high: float
    told: bool


@dataclass(frozen=True)
class Found:
    """What flights tell of a vehicle."""

    numbers: dict[str, Estimate]
    by_speed: bool  # whether the rotors' speeds lag rather than their thrusts, by what fits better
    seconds: float  # of flight that was looked at
    left_out: float  # share of the windows, because rotors were at their limits
    errors: dict[str, float]  # root mean square of what the model leaves, by signal

    @property
    def missing(self) -> list[str]:
        """One line for each number that the flights do not tell."""
        return [
            f"{name.replace('_', ' ')} is not identified: {KINDS[name].manoeuvre}"
            for name, estimate in self.numbers.items()
            if not estimate.told and KINDS[name].manoeuvre and name != "curvature"
        ]
