"""From flight logs to the numbers of a vehicle."""

from collections.abc import Sequence

import numpy as np

from cruise.config import Vehicle
from cruise.errors import CruiseError
from cruise.identify.found import Estimate, Found
from cruise.identify.grid import prepare
from cruise.identify.log import FlightLog
from cruise.identify.search import Search
from cruise.vehicles.checks import check_vehicle


def identify(logs: Sequence[FlightLog], start: Vehicle) -> Found:
    """What the flights tell of a vehicle, from one to start from, whose mass, inertia and arms are taken as known.

    Raises:
        CruiseError: the vehicle has no rotors, or there is nothing to fit.
    """
    check_vehicle(start)
    if start.airframe is None:
        raise CruiseError(f"vehicle {start.name!r} has no rotors: there is nothing to identify; start from another")
    flights = [prepare(log, start) for log in logs]
    search = Search(start, flights)
    search.solve()
    halves = search.half_intervals()
    numbers = {
        name: Estimate(value, value - halves.get(name, np.inf), value + halves.get(name, np.inf), name in halves)
        for name, value in search.numbers._asdict().items()
    }
    seconds = sum(log.duration for log in logs)
    return Found(numbers, search.by_speed, seconds, search.left_out, search.errors)
