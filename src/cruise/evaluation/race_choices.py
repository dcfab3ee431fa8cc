"""What a race may be asked to be, said in the same words and meaning the same at every door."""

import os
from collections.abc import Sequence
from typing import Any, get_args

from cruise.config import Randomisation, Sensing, SensingKind, Track, Vehicle
from cruise.env.draw_sensing import check_sensing
from cruise.env.mixed import each_of
from cruise.errors import CruiseError
from cruise.presets import MAX_RANDOMISE, full_randomisation
from cruise.racing.track_file import load_track
from cruise.vehicles import VehicleChoice, load_vehicle

TrackChoice = Track | str | os.PathLike[str]
FleetChoice = VehicleChoice | Sequence[VehicleChoice]
RandomisationChoice = float | Randomisation
SensingChoice = Sensing | str  # one of `SensingKind`


def find_track(choice: TrackChoice) -> Track:
    """A track, a built-in one by name, or that of a TOML file. Raises CruiseError where there is none."""
    return choice if isinstance(choice, Track) else load_track(choice)


def find_fleet(choice: FleetChoice | None, drones: int) -> tuple[Vehicle, ...]:
    """The vehicle of every drone, fewer than drones taking turns; nothing where none is asked for.

    Raises:
        CruiseError: there are more than drones, one does not exist, or they cannot share a race.
    """
    choices: list[Any] = list(choice) if isinstance(choice, list | tuple) else [] if choice is None else [choice]
    if len(choices) > drones:
        raise CruiseError(f"{len(choices)} vehicles for {drones} drones: give one for all, or at most one per drone")
    known = [load_vehicle(one) for one in choices]
    return each_of(tuple(known[drone % len(known)] for drone in range(drones)), drones) if known else ()


def find_randomisation(choice: RandomisationChoice, vehicle: Vehicle) -> Randomisation:
    """A share of all that a vehicle may differ by, or each spread. Raises CruiseError where the share is too large."""
    if isinstance(choice, Randomisation):
        return choice
    if not 0 <= choice <= MAX_RANDOMISE:
        raise CruiseError(f"randomise must be from 0 to {MAX_RANDOMISE}, got {choice}")
    return full_randomisation(vehicle).scaled(choice)


def find_sensing(choice: SensingChoice) -> Sensing:
    """The sensors of a name, or those that are given. Raises CruiseError where a number of them makes no sense."""
    if isinstance(choice, Sensing):
        check_sensing(choice)
        return choice
    if choice not in get_args(SensingKind):
        raise CruiseError(f"unknown sensing {choice!r}; there are {', '.join(get_args(SensingKind))}, or a Sensing")
    return Sensing(choice)  # type: ignore[arg-type]


def find_spread(share: float, track: Track) -> float:
    """The share of races that start all along the track: none where all start before a gate by chance.

    Raises:
        CruiseError: it is no share.
    """
    if not 0 <= share <= 1:
        raise CruiseError(f"spread_starts must be from 0 to 1, got {share}")
    return 0.0 if track.start is None else float(share)
