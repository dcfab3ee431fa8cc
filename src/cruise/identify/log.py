"""A flight as it was logged, whatever wrote it. Plain NumPy: no JAX."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cruise.errors import CruiseError
from cruise.toml_file import reason, shown

MAX_BYTES = 2_000_000_000
SHORTEST = 2.0  # [s]
FEWEST = 20  # samples of a signal
FASTEST_RATES, FASTEST = 200.0, 200.0  # [rad/s], [m/s]; what is beyond is of another unit


@dataclass(frozen=True)
class FlightLog:
    """Signals over one clock. NaN: no sample there. None: not logged.

    World frame with z up, body frame x forward, y left, z up. A command holds until the next row.
    """

    name: str
    time: Float[ndarray, " T"]  # [s], rising
    throttle: Float[ndarray, " T"]  # collective command, 0 to 1
    rate_command: Float[ndarray, "3 T"]  # body rates asked for [rad/s]
    rates: Float[ndarray, "3 T"]  # body rates measured [rad/s]
    attitude: Float[ndarray, "4 T"] | None = None  # (w, x, y, z), from body to world
    velocity: Float[ndarray, "3 T"] | None = None  # world [m/s]
    acceleration: Float[ndarray, "3 T"] | None = None  # of an accelerometer, in the body's frame [m/s^2]
    motors: Float[ndarray, "4 T"] | None = None  # commands, 0 to 1: front left, front right, rear right, rear left

    @property
    def duration(self) -> float:
        """From the first to the last row [s]."""
        return float(self.time[-1] - self.time[0])


def load_log(path: str | os.PathLike[str]) -> FlightLog:
    """Read a flight log by its ending: `.csv`, `.ulg` of PX4, `.bbl`, `.bfl` or `.txt` of Betaflight.

    Raises:
        CruiseError: no such file, an ending that nobody writes, a library that is not installed, or a log from which
            nothing can be learned; one line.
    """
    readers = {".csv": "csv_log", ".ulg": "ulog", ".bbl": "blackbox", ".bfl": "blackbox", ".txt": "blackbox"}
    place = Path(path)
    ending = place.suffix.lower()
    if ending not in readers:
        raise CruiseError(f"{shown(path)}: a flight log ends in {', '.join(readers)}")
    if place.is_dir():
        raise CruiseError(f"{shown(path)}: is a directory, not a flight log")
    if not place.is_file():
        raise CruiseError(f"{shown(path)}: no such flight log")
    try:
        if not 0 < place.stat().st_size <= MAX_BYTES:
            raise CruiseError(f"{shown(path)}: {'is empty' if place.stat().st_size == 0 else 'is larger than 2 GB'}")
        log = _read(ending, place)
    except CruiseError:
        raise
    except (OSError, ValueError) as error:
        raise CruiseError(f"{shown(path)}: cannot be read: {reason(error)}") from error
    check_log(log)
    return log


def _read(ending: str, place: Path) -> FlightLog:
    """Each reader imports a library of its own."""
    if ending == ".csv":
        from cruise.identify.csv_log import read_csv  # noqa: PLC0415

        return read_csv(place)
    if ending == ".ulg":
        from cruise.identify.ulog import read_ulog  # noqa: PLC0415

        return read_ulog(place)
    from cruise.identify.blackbox import read_blackbox  # noqa: PLC0415

    return read_blackbox(place)


def check_log(log: FlightLog) -> None:
    """Raises CruiseError, in one line, where a log holds nothing that can be learned from."""
    for fault in _faults(log):
        raise CruiseError(f"{log.name}: {fault}")


def _faults(log: FlightLog) -> Iterator[str]:
    if log.time.size < 2:
        yield f"has {log.time.size} rows: a flight has more"
        return
    if not np.isfinite(log.time).all():
        yield f"time of row {int(np.argmin(np.isfinite(log.time))) + 1} is no number"
        return
    steps = np.diff(log.time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 2
        yield f"time does not rise at row {row}: {log.time[row - 2]:g} s, then {log.time[row - 1]:g} s"
    if log.duration < SHORTEST:
        yield f"lasts {log.duration:.2f} s: at least {SHORTEST:g} s are needed"
    if np.median(steps) > 0.025:
        yield f"has {1 / np.median(steps):.0f} rows a second: at least 40 are needed, 250 are good"
    yield from _signal_faults(log)


def _signal_faults(log: FlightLog) -> Iterator[str]:
    for field in fields(log):
        signal = getattr(log, field.name)
        if (
            isinstance(signal, ndarray)
            and (there := int(np.isfinite(np.atleast_2d(signal)).all(axis=0).sum())) < FEWEST
        ):
            yield f"{field.name.replace('_', ' ')}: {there} rows hold numbers, at least {FEWEST} are needed"
            return
    for name, unit, most in (("rates", "rad/s", FASTEST_RATES), ("rate_command", "rad/s", FASTEST_RATES)):
        if (highest := np.nanmax(np.abs(getattr(log, name)))) > most:
            yield f"{name.replace('_', ' ')} reach {highest:.0f} {unit}: are they in degrees?"
    if log.velocity is not None and np.nanmax(np.abs(log.velocity)) > FASTEST:
        yield f"velocity reaches {np.nanmax(np.abs(log.velocity)):.0f} m/s: is it in m/s?"
    for name in ("throttle", "motors"):
        signal = getattr(log, name)
        if signal is not None and (np.nanmin(signal) < -0.01 or np.nanmax(signal) > 1.01):
            yield f"{name} must lie within 0 and 1, not {np.nanmin(signal):g} and {np.nanmax(signal):g}"
    if np.nanmax(log.throttle) <= 0.01:
        yield "throttle never opens: nothing flew"
    if np.nanstd(log.rate_command) == 0:
        yield "rate command never changes"
    if log.attitude is not None and not np.nanmax(np.abs(np.linalg.norm(log.attitude, axis=0) - 1)) < 0.05:
        yield "attitude: quaternions are not of length 1"
