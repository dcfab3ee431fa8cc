"""Whether `cruise identify` finds the numbers of a vehicle again: python -m benchmarks.identification [REPEATS].

Flights that MuJoCo and RotorPy made, with noise, lost samples and a clock of the commands that runs off; for each
number its error, and how often its 95 % interval holds the truth.
"""

import sys
import time
from dataclasses import replace

import numpy as np

from cruise.config import Vehicle
from cruise.identify import FlightLog, identify
from cruise.vehicles import VEHICLES
from examples.fly_to_identify import fly

SECONDS = 20.0
RATE_NOISE, ATTITUDE_NOISE, VELOCITY_NOISE = 0.05, 0.005, 0.05  # standard deviations [rad/s, rad, m/s]
LOST, DRIFT = 0.1, 2e-4  # share of the samples; of the commands' clock [s/s]
RACER = VEHICLES["racer"]
TRUE = replace(RACER, airframe=replace(RACER.airframe, delay=0.032))  # whole rows of the log


def truth(vehicle: Vehicle) -> dict[str, float]:
    """The numbers that are to be found, by the names of `Found`."""
    airframe = vehicle.airframe
    level = airframe.drag.horizontal / vehicle.mass
    return {
        "thrust": vehicle.agility,
        "rotor_lag": airframe.rotors.time_constant,
        "rate_lag": airframe.rates.time_constant,
        "delay": airframe.delay,
        "horizontal_drag": level,
        "vertical_drag": airframe.drag.vertical / vehicle.mass,
        "torque_ratio": airframe.rotors.torque_ratio,
    }


def started(simulator: str) -> Vehicle:
    """What the search starts from: up to a half off in what it is to find. MuJoCo's rate loop looks at 500 Hz."""
    airframe = replace(
        RACER.airframe,
        rotors=replace(RACER.airframe.rotors, time_constant=0.05, torque_ratio=0.015),
        rates=replace(RACER.airframe.rates, time_constant=0.06),
        drag=replace(RACER.airframe.drag, horizontal=0.4, vertical=0.3),
    )
    return replace(RACER, name="start", agility=26.0, substeps=10 if simulator == "mujoco" else 5, airframe=airframe)


def measured(rows: np.ndarray, seed: int) -> FlightLog:
    """A log with all that is wrong with logs: commands stand in rows of their own, on a clock of their own."""
    chance = np.random.default_rng(seed)
    kept = rows[chance.random(len(rows)) > LOST].T
    sensed = kept.copy()
    sensed[1:5] = np.nan
    sensed[5:8] += RATE_NOISE * chance.standard_normal((3, kept.shape[1]))
    sensed[8:12] += ATTITUDE_NOISE / 2 * chance.standard_normal((4, kept.shape[1]))
    sensed[8:12] /= np.linalg.norm(sensed[8:12], axis=0)
    sensed[12:15] += VELOCITY_NOISE * chance.standard_normal((3, kept.shape[1]))
    sensed[15:] = np.nan
    asked = rows.T.copy()
    asked[5:15] = np.nan
    asked[0] = asked[0] * (1 + DRIFT) + 1e-5
    both = np.concatenate([sensed, asked], axis=1)
    both = both[:, np.argsort(both[0], kind="stable")]
    both = both[:, np.concatenate([[True], np.diff(both[0]) > 0])]
    t, command, rest = both[0], both[1:5], both[5:]
    return FlightLog("flight", t, command[0], command[1:], rest[:3], rest[3:7], rest[7:10], motors=rest[10:])


def main(repeats: int) -> None:
    """Print one table a simulator."""
    for simulator in ("mujoco", "rotorpy"):
        real = truth(TRUE)
        if simulator == "mujoco":
            real["vertical_drag"] = real["horizontal_drag"]  # its air is alike along all axes
        rows, begun = fly(TRUE, simulator, SECONDS), time.process_time()
        founds = [identify([measured(rows, seed)], started(simulator)) for seed in range(repeats)]
        spent = (time.process_time() - begun) / repeats
        print(f"{simulator}: {repeats} repeats of {SECONDS:g} s, {spent:.1f} s of CPU each")
        for name, value in real.items():
            ones = [found.numbers[name] for found in founds]
            off = 100 * (np.array([one.value for one in ones]) / value - 1)
            told = sum(one.told for one in ones)
            holds = sum(one.low <= value <= one.high for one in ones if one.told)
            wide = 100 * np.mean([(one.high - one.low) / 2 / value for one in ones if one.told]) if told else np.nan
            error = f"off by {off.mean():+.2f} +- {off.std():.2f} %, at most {np.abs(off).max():.2f} %"
            print(f"  {name:16} {error}; told {told}, interval +-{wide:.1f} %, holds the truth {holds} times")
        print(f"  speeds lag: {sum(found.by_speed for found in founds)}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
