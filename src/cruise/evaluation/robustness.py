"""How a match goes when one thing after the other is not as vehicle and track say."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cruise.config import EXACT, Randomisation, Sensing
from cruise.env.draw_sensing import Sensors, sensors_of, together
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.randomise import SENSED, Shape, draw_conditions, made_for_each
from cruise.env.surroundings import Conditions
from cruise.errors import CruiseError
from cruise.evaluation.matches import STREAM, Match, fly_batch
from cruise.evaluation.metrics import RaceResult, race_result
from cruise.evaluation.statistics import Estimate
from cruise.evaluation.summary import summarise
from cruise.presets import full_randomisation

STRENGTHS = (0.5, 1.0, 1.5, 2.0)  # of the full randomisation
RACES_AT_ONCE = 512  # bounds memory
MAX_EPISODES = 10_000


@dataclass(frozen=True)
class Kind:
    """One thing that may be different."""

    name: str
    unit: str  # of the value on its axis
    fields: tuple[str, ...]  # of `Randomisation`; the value is that of the first
    factor: float = 1.0  # from the field to the unit
    signed: bool = False  # it is that much off in one direction, not at random
    sensing: Sensing | None = None  # by which races are known; `fields` may be its own. None: exactly


KINDS = (
    Kind("mass", "%", ("mass_spread",), 100, signed=True),
    Kind("inertia", "%", ("inertia_spread",), 100, signed=True),
    Kind("thrust", "%", ("thrust_spread",), 100, signed=True),
    Kind("drag", "%", ("drag_spread",), 100, signed=True),
    Kind("lag of rotors and rates", "%", ("lag_spread",), 100, signed=True),
    Kind("demands cut rotor by rotor, up to", "%", ("clip_share",), 100),
    Kind("delay, up to", "ms", ("extra_delay",), 1000),
    Kind("steady wind, up to", "m/s", ("wind_speed",)),
    Kind("gusts, root mean square", "m/s", ("gust_speed",)),
    Kind("gates shifted and turned, up to", "m", ("gate_shift", "gate_turn")),
    Kind("sensors wrong, position by", "m", SENSED),
    Kind("everything at once", "of full", ()),  # no field: all of them
)
_CAMERA = Sensing("camera")
# What drones do not know; beside it all is known well.
_RANGE = Sensing("range", sensor_range=5.0, velocity_bias=0.0, drift_share=0.0, fix_error=0.0)
_RADIO = replace(_RANGE, sensor_range=1.0, opponents_by="radio", radio_delay=0.2)
SENSED_KINDS = (
    Kind("gates shifted so, seen within 5 m", "m", ("gate_shift", "gate_turn"), sensing=_RANGE),
    Kind("camera, gates shifted", "m", ("gate_shift", "gate_turn"), sensing=_CAMERA),
    Kind(
        "camera, velocity biased, up to",
        "m/s",
        ("velocity_bias",),
        sensing=replace(_CAMERA, velocity_bias=0.3),
    ),
    Kind("camera, late by", "ms", ("sensor_latency",), 1000, sensing=replace(_CAMERA, sensor_latency=0.1)),
    Kind("camera, position fixes wrong by", "m", ("fix_error",), sensing=replace(_CAMERA, fix_error=0.1)),
    Kind("opponents told by radio, late by", "ms", ("radio_delay",), 1000, sensing=_RADIO),
)


class Cell(NamedTuple):
    """One strength of one kind."""

    kind: Kind
    strength: float  # of the full randomisation, below 0 where the deviation is downwards
    value: float  # in the kind's unit


class Point(NamedTuple):
    """What was measured there."""

    cell: Cell
    success_rate: Estimate  # of drones
    flying_lap_time: Estimate  # [s]


def cells(full: Randomisation) -> tuple[Cell, ...]:
    """Every kind that `full` has, at every strength, and first nothing at all."""
    table = asdict(full)
    found = [Cell(KINDS[-1], 0.0, 0.0)]
    for kind in KINDS:
        value = table[kind.fields[0]] * kind.factor if kind.fields else 1.0
        strengths = (*(-s for s in reversed(STRENGTHS)), *STRENGTHS) if kind.signed else STRENGTHS
        found += [Cell(kind, strength, strength * value) for strength in strengths if value]
    return tuple(found)


def sensing_cells(full: Randomisation, drones: int) -> tuple[Cell, ...]:
    """Every way not to know the race, at every strength; of opponents where there are any."""
    found = []
    for kind in SENSED_KINDS:
        assert kind.sensing is not None
        value = (asdict(kind.sensing) | asdict(full))[kind.fields[0]] * kind.factor
        if kind.sensing != _RADIO or drones > 1:
            found += [Cell(kind, strength, strength * value) for strength in STRENGTHS]
    return tuple(found)


def measure_robustness(match: Match, episodes: int, seed: int) -> Iterator[Point]:
    """Fly `episodes` races at every cell; one point each, the same for the same `seed`.

    Raises:
        CruiseError: a number out of range.
    """
    if not 1 <= episodes <= MAX_EPISODES:
        raise CruiseError(f"races must be from 1 to {MAX_EPISODES}, got {episodes}")
    full = full_randomisation(match.vehicle)
    yield from _measured(match, cells(full), episodes, seed)
    yield from _measured(match, sensing_cells(full, len(match.team)), episodes, seed)


def _measured(match: Match, table: tuple[Cell, ...], episodes: int, seed: int) -> Iterator[Point]:
    """The points of cells that are flown side by side."""
    env = _env(match, full_randomisation(match.vehicle), table)
    key = jax.random.fold_in(jax.random.key(seed), STREAM)
    results: list[list[RaceResult]] = [[] for _ in table]
    at_once = max(1, min(episodes, RACES_AT_ONCE // (len(table) * len(match.team))))
    for first in range(0, episodes, at_once):
        logs = fly_batch(match, env, jax.random.fold_in(key, first), at_once * len(table))
        for race, log in enumerate(logs):
            results[race % len(table)].append(race_result(log))
    names = match.names
    for cell, flown in zip(table, results, strict=True):
        summary = summarise(match.track, names, flown[:episodes], seed)
        yield Point(cell, summary.success_rate, summary.flying_lap_time)


def _env(match: Match, full: Randomisation, table: tuple[Cell, ...]) -> RaceEnv:
    """The environment in which race number i of a batch is flown under cell i modulo their number."""
    vehicle = made_for_each(match.fleet, full.scaled(max(STRENGTHS)))
    chance, offset = _by_cell(full, table)
    known = _sensors_by_cell(table, match.vehicle.control_dt, match.sensing)

    def draw(key: Array, shape: Shape) -> Conditions:
        strengths, offsets = (_over_races(one, shape[1]) for one in (chance, offset))
        sensors = known and known._replace(numbers=_over_races(known.numbers, shape[1]))
        return draw_conditions(match.track, vehicle, strengths, key, shape, offsets, sensors)

    return make_race_env(match.track, len(match.team), vehicle, perturb=draw)


def _by_cell(full: Randomisation, table: tuple[Cell, ...]) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Strengths and offsets of every field that is random at all, one number per cell."""
    chance: dict[str, np.ndarray] = {}
    offset: dict[str, np.ndarray] = {}
    for name, value in asdict(full).items():
        mine = [cell if name in cell.kind.fields or not cell.kind.fields else None for cell in table]
        chance[name] = np.array([value * c.strength if c and not c.kind.signed else 0.0 for c in mine], np.float32)
        offset[name] = np.array([value * c.strength if c and c.kind.signed else 0.0 for c in mine], np.float32)
    return _random(chance), _random(offset)


def _sensors_by_cell(table: tuple[Cell, ...], control_dt: float, usual: Sensing = EXACT) -> Sensors | None:
    """The sensors of every cell, `usual` where it has none of its own; None where all know everything."""
    sensings = [_scaled(cell.kind.sensing or usual, cell) for cell in table]
    found = [one for sensing in sensings if (one := sensors_of(sensing, control_dt))]
    return together(found) if found else None


def _scaled(sensing: Sensing, cell: Cell) -> Sensing:
    own = {name: cell.strength * value for name, value in asdict(sensing).items() if name in cell.kind.fields}
    return replace(sensing, **own)


def _random(by_cell: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: values for name, values in by_cell.items() if values.any()}


def _over_races(by_cell: Mapping[str, np.ndarray], races: int) -> dict[str, Any]:
    return {name: jnp.tile(jnp.asarray(values), races // len(values)) for name, values in by_cell.items()}
