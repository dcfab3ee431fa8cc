"""`python -m benchmarks.firmware_terms`: the rate loop of the firmware in a race, term by term, read from its memory.

python -m benchmarks.firmware_terms racer-figure-eight                      # stock
python -m benchmarks.firmware_terms racer-figure-eight 'set i_roll = 0' ... # stock, but for these lines
"""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import cruise
from cruise.cli.compilation import prepare_flight
from cruise.config import Firmware
from cruise.interop.betaflight import fleet
from cruise.interop.betaflight.firmware import find_firmware
from cruise.presets import TRACKS
from cruise.storage.policy_file import list_policies
from cruise.vehicles import find_vehicle

AXES, TERMS = ("roll", "pitch", "yaw"), ("P", "I", "D", "F", "S", "sum")  # of its pidData, in order
RANGE = 1000.0  # of a term: all of a motor's range
FULL, IDLE = 0.999, 0.06  # a motor above, or below, is at its limit
ENDED = 0.3  # s before the end of a flight that are left out: a crash


def symbol(program: Path, name: str) -> int:
    """Where the firmware has a variable, from the start of its program."""
    table = subprocess.run(["nm", program], capture_output=True, text=True, check=True).stdout
    found = re.search(rf"^([0-9a-f]+) \w {name}$", table, re.MULTILINE)
    if found is None:
        raise SystemExit(f"{program.name} does not say where its {name} is")
    return int(found.group(1), 16)


class Watched(fleet.Fleet):
    """Notes terms, rates and motors of the first flight at every millisecond."""

    rows: ClassVar[list[np.ndarray]] = []

    def _fly(self, flights: Any, told: np.ndarray) -> None:
        super()._fly(flights, told)
        pid = self._pid(flights[0].process)
        start = int(Path(f"/proc/{pid}/maps").read_text().split("-", 1)[0], 16)
        with open(f"/proc/{pid}/mem", "rb") as memory:
            memory.seek(start + PID_DATA)
            terms = np.frombuffer(memory.read(4 * len(AXES) * len(TERMS)), np.float32)
        Watched.rows.append(np.concatenate([terms, flights[0].motors]))

    def _pid(self, process: Any) -> int:
        return int(process.reply["pid"][0])


def told(rows: np.ndarray, policy: str, fate: str) -> None:
    """Print what the terms did."""
    terms = rows[:, : len(AXES) * len(TERMS)].reshape(-1, len(AXES), len(TERMS)) / RANGE
    motors = rows[:, len(AXES) * len(TERMS) :]
    at_limit = ((motors > FULL) | (motors < IDLE)).any(axis=1)
    print(f"{policy}: {fate}; {len(rows) / 1000:.1f} s; a motor is at its limit in {100 * at_limit.mean():.0f} %")
    print("axis   P rms   I rms   I max   I grows while limited, share   D rms")
    for axis, name in enumerate(AXES):
        p, i, d = (terms[:, axis, k] for k in range(3))
        growth = np.maximum(np.diff(np.abs(i)), 0.0)
        limited = growth[at_limit[1:]].sum() / max(growth.sum(), 1e-12)
        rms = [float(np.sqrt(np.mean(one**2))) for one in (p, i, d)]
        print(
            f"{name:6} {rms[0]:.3f}   {rms[1]:.3f}   {np.abs(i).max():.3f}   {100 * limited:17.0f} %   {rms[2]:18.3f}"
        )


def main(policy: str, *lines: str) -> None:
    """One race of one drone."""
    prepare_flight()
    fleet_made = fleet.Fleet
    from cruise.interop.betaflight import dynamics  # noqa: PLC0415

    assert dynamics.Fleet is fleet_made
    dynamics.Fleet = Watched  # type: ignore[misc]
    meta = list_policies()[policy]
    firmware = Firmware("stock", tuple(lines))
    vehicle = cruise.InSimulator(find_vehicle(meta.vehicle), "betaflight", firmware)
    log = cruise.race(meta.track if meta.track in TRACKS else "ring", 1, policy, seed=2026, vehicle=vehicle)
    rows = np.array(Watched.rows)
    told(rows[: max(1, len(rows) - round(1000 * ENDED))], policy, f"{log.time[-1]:.2f} s flown")


PID_DATA = symbol(find_firmware(), "pidData")

if __name__ == "__main__":
    main(*(sys.argv[1:] or ["racer-figure-eight"]))
