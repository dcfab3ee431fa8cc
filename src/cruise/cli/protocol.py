"""`cruise evaluate --protocol NAME`: races as somebody else measures them."""

import dataclasses
import json
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rich.table import Column, Table

from cruise.cli.console import make_console
from cruise.cli.line_up import LineUp
from cruise.config import EXACT
from cruise.errors import CruiseError

if TYPE_CHECKING:
    from cruise.evaluation.protocol_races import Row
    from cruise.evaluation.protocols import Protocol
    from cruise.storage.policy_file import PolicyMeta


def find_protocol(name: str, races: int | None = None) -> "Protocol":
    """By its name, with fewer races if asked to. Raises CruiseError where there is none, or not so many races."""
    from cruise.evaluation.protocols import PROTOCOLS  # noqa: PLC0415

    if name not in PROTOCOLS:
        raise CruiseError(f"unknown protocol {name!r}: there are {', '.join(PROTOCOLS)}")
    protocol = PROTOCOLS[name]
    if races is None:
        return protocol
    if not 1 <= races <= protocol.races:
        raise CruiseError(f"protocol {name} has from 1 to {protocol.races} races of a field, not {races}")
    return dataclasses.replace(protocol, races=races)


def run_protocol(
    protocol: "Protocol", line_up: LineUp, pool: Sequence[str], line_ups: int | None, seed: int
) -> "list[Row]":
    """Fly every field of a protocol, or line-ups out of a pool. Raises CruiseError where flags do not go together."""
    if not pool:
        if line_ups is not None:
            raise CruiseError("--line-ups are drawn out of a pool: give --pool NAME, once for each of its pilots")
        return list(_fields(protocol, line_up, seed))
    if line_up.policy is not None or line_up.pilot or line_up.drones is not None:
        raise CruiseError("--pool says who races, in fields of the protocol: leave out --policy, --pilot and --drones")
    return _pool(protocol, line_up, pool, protocol.line_ups if line_ups is None else line_ups, seed)


def _fields(protocol: "Protocol", line_up: LineUp, seed: int) -> "Iterator[Row]":
    from cruise.evaluation.measures import Outcome  # noqa: PLC0415  (imports JAX, as the next does)
    from cruise.evaluation.protocol_races import fly_field, rows_of  # noqa: PLC0415

    for track, drones in _cells(protocol, line_up):
        match = dataclasses.replace(line_up, track=track, drones=drones).match(protocol.laps)
        if line_up.randomise == 0.0:
            match = dataclasses.replace(match, randomisation=protocol.randomisation)
        if line_up.sensing == EXACT:
            match = dataclasses.replace(match, sensing=protocol.sensing)
        races = [Outcome.of(log) for log in fly_field(match, protocol, seed)]
        yield from rows_of(track, drones, protocol, races)


def _cells(protocol: "Protocol", line_up: LineUp) -> list[tuple[str, int]]:
    """Tracks and fields that are asked for, and that a policy can race in."""
    from cruise.env.observation import for_any_field  # noqa: PLC0415  (imports JAX)
    from cruise.evaluation.pilot_choice import pilot_meta  # noqa: PLC0415

    tracks, fields = protocol.tracks, protocol.fields
    meta: PolicyMeta | None = None if line_up.policy is None else pilot_meta(line_up.policy)
    if line_up.track is not None:
        tracks = tuple(track for track in tracks if track == line_up.track)
    elif meta is not None and meta.track in tracks:
        tracks = (meta.track,)
    if line_up.drones is not None:
        fields = tuple(field for field in fields if field == line_up.drones)
    elif meta is not None and not for_any_field(meta.observation):
        fields = tuple(field for field in fields if field == meta.drones)
    if not (tracks and fields):
        drones = ", ".join(map(str, protocol.fields))
        raise CruiseError(f"protocol {protocol.name} races {drones} drones on {', '.join(protocol.tracks)}")
    return [(track, field) for track in tracks for field in fields]


def _pool(protocol: "Protocol", line_up: LineUp, pool: Sequence[str], line_ups: int, seed: int) -> "list[Row]":
    from cruise.evaluation.matches import make_match  # noqa: PLC0415  (imports JAX, as the next two do)
    from cruise.evaluation.measures import Outcome  # noqa: PLC0415
    from cruise.evaluation.protocol_races import fly_line_ups, rows_of  # noqa: PLC0415
    from cruise.racing.track_file import load_one_track  # noqa: PLC0415

    if protocol.grid is None:
        raise CruiseError(f"protocol {protocol.name} has no line-ups out of a pool")
    if line_ups < 1:
        raise CruiseError(f"--line-ups must be 1 or more, not {line_ups}")
    (track,) = protocol.tracks
    known = make_match(load_one_track(track), len(pool), list(pool), protocol.laps, vehicle=line_up.vehicle)
    races: list[Outcome] = []
    for logs in fly_line_ups(known, protocol, known.team, line_ups, seed):
        races += [Outcome.of(log) for log in logs]
    return rows_of(track, protocol.line_up, protocol, races)


def show_rows(protocol: "Protocol", rows: "Sequence[Row]", as_json: bool) -> None:
    """A table, or one JSON object."""
    if as_json:
        plain = [row._asdict() | {"measures": {k: v.to_dict() for k, v in row.measures.items()}} for row in rows]
        print(
            json.dumps({"protocol": protocol.name, "about": protocol.about, "rows": plain}, indent=2, allow_nan=False)
        )
        return
    from cruise.evaluation.measures import MEASURES  # noqa: PLC0415

    titles = [f"{MEASURES[name].said} [{MEASURES[name].unit}]".removesuffix(" []") for name in protocol.measures]
    numbers = (Column(title, justify="right") for title in ("drones", "races", *titles))
    table = Table("track", "pilot", *numbers, title=f"protocol {protocol.name}: {protocol.about}")
    for row in rows:
        cells = (_cell(row.measures[name].mean, MEASURES[name].unit) for name in protocol.measures)
        table.add_row(row.track, row.pilot, str(row.drones), str(row.races), *cells)
    make_console().print(table)


def _cell(mean: float, unit: str) -> str:
    if math.isnan(mean):
        return "-"
    return f"{100 * mean:.1f}" if unit == "%" else f"{mean:.2f}"
