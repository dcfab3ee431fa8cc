"""A log on the even steps of a vehicle's rate loop, cut into windows."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cruise.config import Vehicle
from cruise.identify.log import FlightLog

WINDOW = 1.0  # [s]; what a window begins with is free, so that errors of one do not reach the next
GAP, LONGEST_GAP = 0.06, 0.3  # [s] without a sample; a window with a longer one is left out
FEWEST = 8  # samples of a window


class Samples(NamedTuple):
    """What was measured in each of W windows, up to S samples each."""

    times: Float[ndarray, "W S"]  # [s]
    values: Float[ndarray, "C W S"]
    there: Float[ndarray, "W S"]  # 1: a sample, 0: none


class Command(NamedTuple):
    """What was asked for, as its integral, which makes a mean over any step exact."""

    times: Float[ndarray, " K"]  # [s]
    integral: Float[ndarray, "C K"]

    def mean(self, edges: Float[ndarray, " N"], delay: float, drift: float) -> Float[ndarray, "C K"]:
        """Mean over every step between `edges`, as it arrives after a delay [s] on a clock that runs off by `drift`."""
        at = (edges - delay) - drift * (edges - self.times[0])
        steps = np.array([np.diff(np.interp(at, self.times, each)) for each in self.integral])
        return steps / np.diff(edges)


class Flight(NamedTuple):
    """A log, ready to be compared with a model."""

    name: str
    gravity: float  # [m/s^2]
    dt: float  # of the even steps [s]
    row: float  # from one measured rate to the next, usually [s]
    edges: Float[ndarray, " N"]  # of the even steps [s]
    throttle: Command
    rate_command: Command
    motors: Command | None
    rates: Float[ndarray, "3 N"]  # at the edges [rad/s]
    rotation: Float[ndarray, "3 3 N"] | None  # from body to world
    velocity: Float[ndarray, "3 N"] | None  # world [m/s]
    acceleration: Samples | None  # body
    measured_rates: Samples
    measured_velocity: Samples | None
    windows: int


def prepare(log: FlightLog, vehicle: Vehicle) -> Flight:
    """A log on the steps of the vehicle's rate loop."""
    dt = vehicle.control_dt / vehicle.substeps
    edges = np.arange(log.time[0], log.time[-1], dt)
    windows = max(1, int(log.duration / WINDOW))
    place = np.minimum((np.floor((log.time - log.time[0]) / WINDOW)).astype(int), windows - 1)
    rotation = None
    if log.attitude is not None:
        attitude = _on_grid(log.time, _continuous(log.attitude), edges)
        rotation = rotation_matrix(attitude / np.linalg.norm(attitude, axis=0))
    return Flight(
        name=log.name,
        gravity=vehicle.gravity,
        dt=dt,
        row=float(np.median(np.diff(log.time[np.isfinite(log.rates).all(axis=0)]))),
        edges=edges,
        throttle=_command(log.time, log.throttle[None]),
        rate_command=_command(log.time, log.rate_command),
        motors=None if log.motors is None else _command(log.time, log.motors),
        rates=_on_grid(log.time, log.rates, edges),
        rotation=rotation,
        velocity=None if log.velocity is None else _on_grid(log.time, log.velocity, edges),
        acceleration=None if log.acceleration is None else _samples(log.time, log.acceleration, place, windows),
        measured_rates=_samples(log.time, log.rates, place, windows),
        measured_velocity=None if log.velocity is None else _samples(log.time, log.velocity, place, windows),
        windows=windows,
    )


def rotation_matrix(attitude: Float[ndarray, "4 N"]) -> Float[ndarray, "3 3 N"]:
    """R_WB of unit quaternions (w, x, y, z)."""
    w, x, y, z = attitude
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _continuous(attitude: Float[ndarray, "4 T"]) -> Float[ndarray, "4 T"]:
    """The same attitudes without jumps of sign, where q becomes -q."""
    there = np.isfinite(attitude).all(axis=0)
    found = np.full_like(attitude, np.nan)
    q = attitude[:, there]
    turned = np.where((q[:, 1:] * q[:, :-1]).sum(axis=0) < 0, -1.0, 1.0)
    found[:, there] = q * np.concatenate([[1.0], np.cumprod(turned)])
    return found


def _on_grid(time: ndarray, values: ndarray, edges: ndarray) -> ndarray:
    """Straight lines between the samples that there are."""
    rows = []
    for row in values:
        there = np.isfinite(row)
        rows.append(np.interp(edges, time[there], row[there]))
    return np.array(rows)


def _command(time: ndarray, values: ndarray) -> Command:
    """A command that holds until the next; where a sample is missing the one before holds on."""
    held = values.copy()
    for row in held:
        there = np.isfinite(row)
        last = np.maximum.accumulate(np.where(there, np.arange(row.size), -1))
        row[:] = np.where(last >= 0, row[np.maximum(last, 0)], row[np.argmax(there)])
    integral = np.concatenate([np.zeros((len(held), 1)), np.cumsum(held[:, :-1] * np.diff(time), axis=1)], axis=1)
    return Command(time, integral)


def _samples(time: ndarray, values: ndarray, place: Int[ndarray, " T"], windows: int) -> Samples:
    """Samples by window, those with a gap left empty."""
    there = np.isfinite(values).all(axis=0)
    chosen = [np.flatnonzero(there & (place == w)) for w in range(windows)]
    gap = float(np.clip(3 * np.median(np.diff(time[there])), GAP, LONGEST_GAP))
    chosen = [rows if _whole(time[rows], gap) else rows[:0] for rows in chosen]
    size = max(FEWEST, *(rows.size for rows in chosen))
    times, mask = np.zeros((windows, size)), np.zeros((windows, size))
    found = np.zeros((len(values), windows, size))
    for w, rows in enumerate(chosen):
        times[w] = time[rows[0]] if rows.size else 0.0
        times[w, : rows.size], mask[w, : rows.size] = time[rows], 1.0
        found[:, w, : rows.size] = values[:, rows]
    return Samples(times, found, mask)


def _whole(times: ndarray, gap: float) -> bool:
    return times.size >= FEWEST and float(np.diff(times).max()) <= gap


def without(samples: Samples, windows: Bool[ndarray, " W"]) -> Samples:
    """The samples but those of some windows."""
    return samples._replace(there=samples.there * ~windows[:, None])
