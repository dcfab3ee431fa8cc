"""Races under a named protocol."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import Track
from cruise.errors import CruiseError
from cruise.evaluation.matches import Match, run_races
from cruise.evaluation.measures import Outcome, measured
from cruise.evaluation.protocols import Protocol
from cruise.evaluation.statistics import Estimate
from cruise.pilots.base import Pilot
from cruise.pilots.pool import Pool
from cruise.racing.grid import Start
from cruise.rollout import fly_from, team_rules
from cruise.storage.race_log import RaceLog
from cruise.storage.recorder import RaceInfo, race_logs

RACES_AT_ONCE = 512  # of line-ups


class Row(NamedTuple):
    """What a protocol reports of one pilot in one field on one track."""

    track: str
    drones: int
    pilot: str
    races: int
    measures: dict[str, Estimate]


def fly_field(match: Match, protocol: Protocol, seed: int) -> list[RaceLog]:
    """The races of one field: from the protocol's grid, or from starts by chance."""
    if protocol.grid is None:
        return list(run_races(match, protocol.races, seed))
    _refuse_variants(match.track)
    start = _grid_start(protocol, match.track, len(match.team))
    return _flown(match, protocol, start, seed)


def fly_line_ups(
    match: Match, protocol: Protocol, pool: Sequence[Pilot], line_ups: int, seed: int
) -> Iterator[list[RaceLog]]:
    """Random line-ups out of a pool, each from all starts of the grid; logs of some line-ups at a time.

    `match` says where and in which vehicle.
    """
    size, drones = protocol.races, protocol.line_up
    chosen = np.random.default_rng(seed).integers(len(pool), size=(line_ups, drones))
    names = np.array([pilot.name for pilot in pool])
    at_once = max(1, RACES_AT_ONCE // size)
    for first in range(0, line_ups, at_once):
        some = chosen[first : first + at_once]
        who = np.repeat(some, size, axis=0).T  # [N, E]
        start = _grid_start(protocol, match.track, drones, len(some))
        team = (Pool(tuple(pool), jnp.asarray(who)),) * drones
        logs = _flown(dataclasses.replace(match, team=team), protocol, start, seed)
        yield [dataclasses.replace(log, pilots=names[who[:, race]]) for race, log in enumerate(logs)]


def rows_of(track: str, drones: int, protocol: Protocol, races: Sequence[Outcome]) -> list[Row]:
    """One row per pilot."""
    pilots = dict.fromkeys(name for race in races for name in race.log.pilots.tolist())
    return [
        Row(
            track,
            drones,
            pilot,
            sum(pilot in race.log.pilots.tolist() for race in races),
            {name: measured(name, races, pilot) for name in protocol.measures},
        )
        for pilot in pilots
    ]


def _refuse_variants(track: Track) -> None:
    if track.variants:
        raise CruiseError(f"{track.name} is another track in every race: this protocol has one")


def _grid_start(protocol: Protocol, track: Track, drones: int, copies: int = 1) -> Start:
    """The first starts of a protocol's grid, some times over."""
    assert protocol.grid is not None
    position, heading = (table[..., : protocol.races] for table in protocol.grid.places(track, drones))
    gate = jnp.full(heading.shape[1] * copies, track.start_gate)
    return Start(jnp.asarray(np.tile(position, copies), jnp.float32), jnp.asarray(np.tile(heading, copies)), gate)


def _flown(match: Match, protocol: Protocol, start: Start, seed: int) -> list[RaceLog]:
    """All races from these starts."""
    env, team, vehicle, races = match.env, match.team, match.vehicle, start.gate.shape[0]
    rules = team_rules(team, vehicle.collision_distance, match.track.gates_to_finish(match.laps), (races,))
    steps = round((protocol.time_limit or match.time_limit) / vehicle.control_dt)
    flight = fly_from(env, team, rules, jax.jit(env.begin)(start), jax.random.key(seed), steps)
    names = tuple(pilot.name for pilot in team)
    info = RaceInfo(match.track, match.laps, vehicle.name, vehicle.collision_distance, names, vehicle.collision_aspect)
    return race_logs(flight, info)
