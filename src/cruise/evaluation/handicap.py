"""Does a stronger drone get past a weaker one? Two drones of one pilot, one of them with more thrust."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cruise.config import Track, Vehicle
from cruise.errors import CruiseError
from cruise.evaluation.matches import make_match, run_races
from cruise.evaluation.metrics import crossing_times, race_result
from cruise.evaluation.pilot_choice import PilotChoice
from cruise.evaluation.statistics import Estimate, rate_estimate
from cruise.storage.race_log import RaceLog

STRONG, WEAK = 0, 1  # drones; where they stand at the start is drawn


@dataclass(frozen=True)
class Handicap:
    """What races of a stronger against a weaker drone say; shares of races, 1 being all."""

    track: str
    pilot: str
    races: int
    chances: tuple[int, int]  # races in which the stronger, and the weaker, was behind at the first gate
    passes: tuple[Estimate, Estimate]  # of these, share in which it was ahead at a later gate that both passed
    won: tuple[Estimate, Estimate]  # share of all races that it won
    out: tuple[Estimate, Estimate]  # share of all races in which it crashed


def stronger(vehicle: Vehicle, share: float) -> Vehicle:
    """The vehicle with so much more thrust, all of which an action can command.

    Raises:
        CruiseError: it has no rotors, or would have no thrust.
    """
    if vehicle.airframe is None:
        raise CruiseError(f"vehicle {vehicle.name!r} has no rotors that could be stronger")
    if not -1 < share <= 1:
        raise CruiseError(f"thrust must be a share above -1 and up to 1, not {share:g}")
    rotors = replace(vehicle.airframe.rotors, max_thrust=(1 + share) * vehicle.airframe.rotors.max_thrust)
    airframe, name = replace(vehicle.airframe, rotors=rotors), f"{vehicle.name}{100 * share:+g}%"
    return replace(vehicle, name=name, airframe=airframe, agility=(1 + share) * vehicle.agility)


def measure_handicap(
    track: Track, pilot: PilotChoice, vehicle: Vehicle, thrust: float, episodes: int, seed: int
) -> Handicap:
    """Race a drone with `thrust` more, as a share, against one without, both by one pilot.

    Full command of the stronger one is all its thrust, as that of the weaker is.

    Raises:
        CruiseError: as `stronger`, `make_match` and `run_races`.
    """
    match = make_match(track, 2, pilot, vehicle=[stronger(vehicle, thrust), vehicle])
    strong, weak = match.team
    if strong.agility == weak.agility:
        strong = replace(strong, agility=(1 + thrust) * strong.agility)  # type: ignore[type-var]
    logs = run_races(replace(match, team=(strong, weak)), episodes, seed)
    return _measured(track.name, weak.name, logs)


def _measured(track: str, pilot: str, logs: Iterable[RaceLog]) -> Handicap:
    passes: tuple[list[float], list[float]] = ([], [])
    results = []
    for log in logs:
        results.append(race_result(log))
        who = behind_at_first(log)
        if who is not None:
            passes[who].append(float(got_past(log, who)))

    def each(share: Any) -> tuple[Estimate, Estimate]:
        strong, weak = (rate_estimate([float(share(result, drone)) for result in results], 1) for drone in (0, 1))
        return strong, weak

    return Handicap(
        track,
        pilot,
        len(results),
        chances=(len(passes[STRONG]), len(passes[WEAK])),
        passes=(rate_estimate(passes[STRONG], 1), rate_estimate(passes[WEAK], 1)),
        won=each(lambda result, drone: result.winner == drone),
        out=each(lambda result, drone: bool(result.drones[drone].collision)),
    )


def behind_at_first(log: RaceLog) -> int | None:
    """Who came second to the first gate; None where not both did."""
    first = crossing_times(log)[:, 0]
    return int(np.argmax(first)) if np.isfinite(first).all() else None


def got_past(log: RaceLog, drone: int) -> bool:
    """Whether a drone of two was ahead at a gate that both passed."""
    times = crossing_times(log)
    return bool((times[drone] < times[1 - drone]).any())
