"""When rotors are at their limits, where the rate loop cannot do what it is asked for."""

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from cruise.config import Vehicle
from cruise.dynamics.rotors import Demand, each_thrust
from cruise.identify.grid import WINDOW, Flight
from cruise.identify.model import Numbers

MOST = 0.02  # of a window


def at_limits(vehicle: Vehicle, numbers: Numbers, flight: Flight) -> Bool[ndarray, " W"]:
    """The windows in which rotors are at their limits, so that rates do not follow as they should."""
    window = np.minimum(((flight.edges[:-1] - flight.edges[0]) / WINDOW).astype(int), flight.windows - 1)
    if flight.motors is not None:
        each = flight.motors.mean(flight.edges, 0.0, 0.0)
        beyond = ((each > 0.999) | (each < 0.001)).any(axis=0)
    else:
        beyond = _demanded_too_much(vehicle, numbers, flight)
    share = np.bincount(window, beyond, flight.windows) / np.maximum(np.bincount(window, minlength=flight.windows), 1)
    return np.asarray(share > MOST)


def _demanded_too_much(vehicle: Vehicle, numbers: Numbers, flight: Flight) -> Bool[ndarray, " K"]:
    """By the demand of the start's own rate loop on its own rotors."""
    assert vehicle.airframe is not None
    rotors = vehicle.airframe.rotors
    asked = flight.rate_command.mean(flight.edges, numbers.delay, 0.0)
    error = (asked - flight.rates[:, :-1]) / numbers.rate_lag
    torque = tuple(moment * one for moment, one in zip(vehicle.inertia, error, strict=True))
    throttle = flight.throttle.mean(flight.edges, numbers.delay, 0.0)[0]
    each = np.array(each_thrust(rotors, Demand(vehicle.mass * numbers.thrust * throttle, torque)))
    return np.asarray(((each > rotors.max_thrust) | (each < rotors.min_thrust)).any(axis=0))
