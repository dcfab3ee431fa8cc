"""From flight logs to a vehicle: which numbers of it the flights tell, how surely, and which manoeuvre is missing."""

from cruise.identify.fit import identify
from cruise.identify.found import Found
from cruise.identify.log import FlightLog, load_log

__all__ = ["FlightLog", "Found", "identify", "load_log"]
