"""`python -m benchmarks.firmware`: shipped policies told thrust and rates, in our simulator and in real firmware."""

import json
import resource
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

import tyro

import cruise
from cruise.cli.compilation import prepare_flight
from cruise.config import Firmware, FirmwareSettings, Vehicle
from cruise.evaluation.summary import Evaluation
from cruise.presets import TRACKS
from cruise.storage.policy_file import list_policies
from cruise.vehicles import find_vehicle

WHERE: tuple[FirmwareSettings | None, ...] = (None, "matched", "stock")  # None: our own simulator
ELSE = "ring"  # where a policy flies that was trained on no one track


@dataclass(frozen=True)
class InFirmware:
    """Success and flying lap of each, from the same starts."""

    policies: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME...")] = ()
    """Which; by default all whose vehicles are told thrust and body rates."""
    drones: int = 1
    """In each race, all flown by the policy."""
    episodes: int = 100
    """Races of each."""
    seed: int = 2026
    """Of their starts."""
    json: bool = False
    """One JSON object a line instead of rows of a table."""

    def run(self) -> None:
        """A row of each policy, as soon as it has flown."""
        prepare_flight()
        if not self.json:
            print("| policy, track | " + " | ".join(name or "ours" for name in WHERE) + " |\n|---|---|---|---|")
        for policy in self.policies or tuple(of_thrust_and_rates()):
            self._fly(policy)

    def _fly(self, policy: str) -> None:
        meta = list_policies()[policy]
        vehicle, track = find_vehicle(meta.vehicle), meta.track if meta.track in TRACKS else ELSE
        cells: list[str] = []
        lap = float("nan")
        for name in WHERE:
            before = _processor_time()
            found = cruise.evaluate(
                track, self.drones, policy, episodes=self.episodes, seed=self.seed, vehicle=flown(vehicle, name)
            )
            lap = lap if name else found.flying_lap_time.mean
            cells.append(cell(found, lap if name else None))
            if self.json:
                row = {"settings": name, "processor_s": round(_processor_time() - before, 1)} | found.to_dict()
                print(json.dumps(row), flush=True)
        if not self.json:
            print(f"| `{policy}`, {track} | " + " | ".join(cells) + " |", flush=True)


def of_thrust_and_rates() -> Iterator[str]:
    """Shipped policies of vehicles that firmware can fly."""
    for name, meta in list_policies().items():
        vehicle = find_vehicle(meta.vehicle)
        if vehicle.airframe is not None and vehicle.control == "ctbr":
            yield name


def flown(vehicle: Vehicle, settings: FirmwareSettings | None) -> Any:
    """What moves it."""
    return vehicle if settings is None else cruise.InSimulator(vehicle, "betaflight", Firmware(settings))


def cell(found: Evaluation, ours: float | None) -> str:
    """Share that finished and flying lap, with 95 % intervals, and how much slower than `ours` [s] that is."""
    done, lap = found.success_rate, found.flying_lap_time
    share = f"{100 * done.mean:.3g} % ({100 * done.low:.3g} to {100 * done.high:.3g})"
    slower = "" if ours is None else f" ({100 * (lap.mean / ours - 1):+.1f} %)"
    return f"{share}, {lap.mean:.3f} +- {(lap.high - lap.low) / 2:.3f} s{slower}"


def _processor_time() -> float:
    """Of this process and of what it has started and waited for [s]."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in both)


if __name__ == "__main__":
    tyro.cli(InFirmware).run()
