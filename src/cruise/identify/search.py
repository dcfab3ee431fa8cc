"""The search for the numbers: least squares over all windows of all logs, and the errors of what it finds."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import least_squares
from scipy.stats import t as student

from cruise.config import Vehicle
from cruise.dynamics.rotors import places
from cruise.errors import CruiseError
from cruise.identify import model
from cruise.identify.found import KINDS
from cruise.identify.grid import Flight, without
from cruise.identify.limits import at_limits
from cruise.identify.model import Body, Numbers

SURE = 0.25  # half an interval per value beyond which a number counts as not identified
SURE_DELAY = 0.01  # likewise [s]
CONFIDENCE = 0.95
SYSTEMATIC = 0.02  # what no flight makes surer, because no drone is quite what its equations say
FLOORS = {"rates": 0.02, "yaw": 0.02, "velocity": 0.03, "lift": 0.1}  # no signal is trusted beyond [rad/s, m/s, m/s^2]
MOST_LEFT_OUT = 0.9  # of the windows
FREE_STARTS = (0.0, 0.02, 0.05)  # delays to begin the search at, beside the vehicle's own [s]
TIMES = ("rotor_lag", "rate_lag", "delay")
NUISANCES = ("drift", "damping", "yaw_damping", "curvature")
BY_RATES = ("rotor_lag", "rate_lag", "delay", "drift", "damping")


class Search:
    """The search for the numbers."""

    def __init__(self, start: Vehicle, flights: Sequence[Flight]) -> None:
        assert start.airframe is not None
        self.start, self.by_speed = start, False
        self.body = Body(start.mass, start.inertia, tuple(places(start.airframe.rotors)))
        self.numbers = _numbers_of(start)
        self.logged, self.left_out = list(flights), 0.0
        self._leave_out_limits()
        self.errors: dict[str, float] = {}
        self.free = self._asked()
        self.resolution = max(max(flight.dt, flight.row) for flight in flights)

    def _leave_out_limits(self) -> None:
        """Look at rates where the rotors could do what was asked of them only."""
        limited = [at_limits(self.start, self.numbers, flight) for flight in self.logged]
        self.left_out = float(np.mean(np.concatenate(limited)))
        if self.left_out > MOST_LEFT_OUT:
            raise CruiseError(
                f"rotors are at their limits in {100 * self.left_out:.0f} % of the seconds: fly more gently, or mend "
                "inertia, arms and thrust of the vehicle to start from"
            )
        self._kept: dict[int, Any] = {}
        pairs = zip(self.logged, limited, strict=True)
        self.flights = [flight._replace(measured_rates=without(flight.measured_rates, out)) for flight, out in pairs]

    def _asked(self) -> list[str]:
        """The numbers that these logs could tell at all."""
        names = list(BY_RATES)
        if _lifts(self.flights):
            names.append("thrust")
        if any(_group_of_lift(flight) == "velocity" for flight in self.flights):
            names += ["horizontal_drag", "vertical_drag"]
        if any(flight.motors is not None for flight in self.flights):
            names += ["torque_ratio", "yaw_damping"]
        return names

    def solve(self) -> None:
        """Find the numbers; whether thrusts or speeds lag, and whether the thrust map is bent, is what fits better."""
        self._begin()
        self._search()
        self._leave_out_limits()
        if "thrust" in self.free:
            self._choose()
            self._bend()
        self._search()
        self._fix_what_is_not_told()

    def _choose(self) -> None:
        """Let the rotors' speeds lag where that leaves less."""
        before, numbers = self._cost(), self.numbers
        self.by_speed = True
        self._search()
        if self._cost() > before:
            self.by_speed, self.numbers = False, numbers
            self._weigh()

    def _cost(self) -> float:
        return float(sum(np.log(error) for name, error in self.errors.items()))

    def _bend(self) -> None:
        """Let the thrust map be bent where that is more than chance."""
        numbers = self.numbers
        self.free.append("curvature")
        self._search()
        if abs(self.numbers.curvature) < 3 * self._errors_of_numbers()["curvature"]:
            self.free.remove("curvature")
            self.numbers = numbers

    def _begin(self) -> None:
        """From the likeliest delay, since the search finds the nearest valley only."""
        delays = {self.numbers.delay, *FREE_STARTS}
        tries = [self.numbers._replace(delay=delay) for delay in sorted(delays)]
        self.numbers = min(tries, key=lambda one: sum(float((rest**2).sum()) for rest in self._rates(one)))
        self._weigh()

    def _rates(self, numbers: Numbers) -> list[ndarray]:
        return [self._rates_of(flight, numbers) for flight in self.flights]

    def _rates_of(self, flight: Flight, numbers: Numbers) -> Float[ndarray, "3 W S"]:
        """Kept for the next call, since most differences do not touch them."""
        key = (id(flight), *(getattr(numbers, name) for name in BY_RATES))
        if self._kept.get(id(flight), (None,))[0] != key:
            self._kept[id(flight)] = (key, model.rate_residuals(flight, numbers))
        return self._kept[id(flight)][1]

    def _residuals(self, flight: Flight, numbers: Numbers) -> dict[str, Float[ndarray, "C W S"]]:
        """By signal, in its own unit."""
        found = {"rates": self._rates_of(flight, numbers)}
        kind = _group_of_lift(flight)
        if kind:
            function = {"velocity": model.velocity_residuals, "lift": model.lift_residuals}[kind]
            found[kind] = function(flight, numbers, self.by_speed)
        if flight.motors is not None:
            found["yaw"] = model.yaw_residuals(flight, numbers, self.by_speed, self.body)
        return found

    def _weigh(self) -> None:
        """The root mean square of each signal's residuals, by which it is weighed."""
        squares: dict[str, list[float]] = {}
        for flight in self.flights:
            for name, rest in self._residuals(flight, self.numbers).items():
                total = squares.setdefault(name, [0.0, 0.0])
                total[0] += float((rest**2).sum())
                total[1] += float((rest != 0).sum())
        self.errors = {name: max(float(np.sqrt(a / max(b, 1.0))), FLOORS[name]) for name, (a, b) in squares.items()}

    def _rows(self, numbers: Numbers) -> list[Float[ndarray, "W M"]]:
        """Weighed residuals, one row a window, flight by flight."""
        rows = []
        for flight in self.flights:
            parts = self._residuals(flight, numbers).items()
            weighed = [rest.transpose(1, 0, 2).reshape(flight.windows, -1) / self.errors[name] for name, rest in parts]
            rows.append(np.concatenate(weighed, axis=1))
        return rows

    def _with(self, values: ndarray) -> Numbers:
        return self.numbers._replace(**dict(zip(self.free, map(float, values), strict=True)))

    def _slopes(self, values: ndarray) -> list[Float[ndarray, "P W M"]]:
        """Derivatives of the rows by each free number, by differences."""
        columns, here = [], self._rows(self._with(values))
        for k, name in enumerate(self.free):
            off = np.zeros(len(values))
            off[k] = KINDS[name].step
            ahead = self._rows(self._with(values + off))
            columns.append([(one - other) / KINDS[name].step for one, other in zip(ahead, here, strict=True)])
        return [np.array(each) for each in zip(*columns, strict=True)]

    def _values(self) -> ndarray:
        return np.array([getattr(self.numbers, name) for name in self.free])

    def _search(self) -> None:
        kinds = [KINDS[name] for name in self.free]
        result = least_squares(
            lambda values: np.concatenate([rows.ravel() for rows in self._rows(self._with(values))]),
            self._values(),
            jac=lambda values: (
                np.concatenate([each.reshape(len(self.free), -1) for each in self._slopes(values)], axis=1).T
            ),
            bounds=([kind.low for kind in kinds], [kind.high for kind in kinds]),
            x_scale="jac",
            max_nfev=40,
        )
        self.numbers = self._with(result.x)
        self._weigh()

    def _errors_of_numbers(self) -> dict[str, float]:
        """Standard errors that hold where residuals of one window depend on each other: the sandwich by clusters."""
        values = self._values()
        slopes, rows = self._slopes(values), self._rows(self.numbers)
        information = sum(np.einsum("pwm,qwm->pq", each, each) for each in slopes)
        scores = np.concatenate([np.einsum("pwm,wm->wp", each, row) for each, row in zip(slopes, rows, strict=True)])
        scores = scores[(scores != 0).any(axis=1)]
        count = len(scores)
        bread = np.linalg.pinv(information, hermitian=True)
        meat = scores.T @ scores * count / max(count - len(values), 1)
        spread = np.sqrt(np.maximum(np.diag(bread @ meat @ bread), 0.0))
        self.degrees = max(count - len(values), 1)
        return dict(zip(self.free, map(float, spread), strict=True))

    def _fix_what_is_not_told(self) -> None:
        """Numbers whose intervals say nothing are those of the start again, and the rest is found anew."""
        self.spread = self._errors_of_numbers()
        given = _numbers_of(self.start)
        while untold := [name for name in self.free if not self._is_told(name)]:
            self.numbers = self.numbers._replace(**{name: getattr(given, name) for name in untold})
            self.free = [name for name in self.free if name not in untold]
            self._search()
            self.spread = self._errors_of_numbers()

    def _half(self, name: str) -> float:
        """Half of an interval: chance, and what the equations leave out.

        No time is surer than half a step of the log or of the loop, and no other number than `SYSTEMATIC`. What motors
        are told between two rows is not in the log, while a step of the yaw rate dies away within the loop's lag.
        """
        chance = float(student.ppf((1 + CONFIDENCE) / 2, self.degrees)) * self.spread[name]
        if name in TIMES:
            return float(np.hypot(chance, self.resolution / 2))
        between = self.resolution / 2 / self.numbers.rate_lag if name == "torque_ratio" else 0.0
        return float(np.hypot(chance, np.hypot(SYSTEMATIC, between) * abs(getattr(self.numbers, name))))

    def _is_told(self, name: str) -> bool:
        half, value = self._half(name), abs(getattr(self.numbers, name))
        if name in NUISANCES:
            return True
        return half < SURE_DELAY if name == "delay" else half < SURE * value

    def half_intervals(self) -> dict[str, float]:
        """Half of the interval of each number that was told."""
        return {name: self._half(name) for name in self.free}


def _lifts(flights: Sequence[Flight]) -> bool:
    """Whether anything measured says how much thrust there is."""
    return any(_group_of_lift(flight) for flight in flights)


def _group_of_lift(flight: Flight) -> str:
    if flight.measured_velocity is not None and flight.rotation is not None:
        return "velocity"
    return "lift" if flight.acceleration is not None else ""


def _numbers_of(vehicle: Vehicle) -> Numbers:
    airframe = vehicle.airframe
    assert airframe is not None
    return Numbers(
        thrust=vehicle.agility,
        curvature=0.0,
        rotor_lag=max(airframe.rotors.time_constant, 2e-3),
        rate_lag=airframe.rates.time_constant,
        delay=airframe.delay,
        drift=0.0,
        damping=0.0,
        yaw_damping=0.0,
        horizontal_drag=airframe.drag.horizontal / vehicle.mass,
        vertical_drag=airframe.drag.vertical / vehicle.mass,
        torque_ratio=airframe.rotors.torque_ratio,
    )
