"""Poles, walls and whatever else stands on a track: declared here and nowhere else. Plain Python and NumPy.

A new kind is a dataclass in `cruise.config`, a `SolidKind` here and a `COLLISION_` of its name in
`cruise.racing.events`. Its outline, an upright box or cylinder, is what logs store and screens draw.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from cruise import geometry, toml_file
from cruise.config import Obstacle, Pole, Vec3, Wall
from cruise.geometry import Number, Vector
from cruise.racing import track_schema as schema
from cruise.racing.track_schema import Check, Table

NOWHERE = -1000.0  # height at which a solid is that is not there [m]


class Outline(NamedTuple):
    """The upright box that encloses a solid, or the cylinder in it."""

    kind: str  # of the solid
    shape: Literal["box", "cylinder"]
    centre_w: Vec3  # [m]
    size: Vec3  # along its heading, across it, height; a cylinder's diameter twice [m]
    yaw: float = 0.0  # heading of its first side [rad]


class SolidKind(NamedTuple):
    """What the package knows of one kind of solid."""

    name: str  # of `Collisions` and events
    table: str  # [[...]] in a track file
    made_of: type
    keys: Mapping[str, Check]  # of its table; `position` and those of `required` must be there
    required: Mapping[str, str]  # what they are
    read: Callable[[Table], Any]  # of a table without faults
    write: Callable[[Any], dict[str, Any]]
    column: Callable[[Any], tuple[float, ...]]  # its numbers, as `contact` takes them; x, y, z first
    of_column: Callable[[list[float]], Any]  # the other way
    contact: Callable[[Any, Vector, Vector], Number]  # (numbers, start, end) -> fraction of the step, or NEVER
    outline: Callable[[Any], Outline]


def _pole_contact(pole: Any, start_w: Vector, end_w: Vector) -> Number:
    """`pole`: middle of its foot, radius, height."""
    x, y, z, radius, height = (pole[i] for i in range(5))
    start, end = ((point[0] - x, point[1] - y, point[2] - z) for point in (start_w, end_w))
    return geometry.meet_cylinder(start, end, radius, height)


def _wall_contact(wall: Any, start_w: Vector, end_w: Vector) -> Number:
    """`wall`: its centre, heading, half size."""
    x, y, z, cos_yaw, sin_yaw, *half = (wall[i] for i in range(8))
    start, end = (
        geometry.to_gate((cos_yaw, sin_yaw), (point[0] - x, point[1] - y, point[2] - z)) for point in (start_w, end_w)
    )
    return geometry.meet_box(start, end, half)


def _pole_outline(pole: Pole) -> Outline:
    (x, y, z), width = pole.base_w, 2 * pole.radius
    return Outline("pole", "cylinder", (x, y, z + pole.height / 2), (width, width, pole.height))


KINDS = (
    SolidKind(
        name="pole",
        table="poles",
        made_of=Pole,
        keys={"position": schema.point, "radius": schema.positive, "height": schema.positive},
        required={
            "position": "the middle of its foot, as in position = [3, 0, 0]",
            "radius": "as in radius = 0.1",
            "height": "as in height = 3",
        },
        read=lambda table: Pole(schema.vec3(table["position"]), float(table["height"]), float(table["radius"])),
        write=lambda pole: {"position": list(pole.base_w), "radius": pole.radius, "height": pole.height},
        column=lambda pole: (*pole.base_w, pole.radius, pole.height),
        of_column=lambda c: Pole((c[0], c[1], c[2]), c[4], c[3]),
        contact=_pole_contact,
        outline=_pole_outline,
    ),
    SolidKind(
        name="wall",
        table="walls",
        made_of=Wall,
        keys={"position": schema.point, "size": schema.sides, "yaw_deg": schema.number, "yaw_rad": schema.number},
        required={
            "position": "its centre, as in position = [3, 0, 1.5]",
            "size": "length, thickness and height, as in size = [4, 0.2, 3]",
        },
        read=lambda table: Wall(schema.vec3(table["position"]), schema.vec3(table["size"]), schema.angle(table, "yaw")),
        write=lambda wall: {
            "position": list(wall.position_w),
            "size": list(wall.size),
            **schema.angle_key("yaw", wall.yaw),
        },
        column=lambda wall: (*wall.position_w, *geometry.heading_of(wall.yaw), *(side / 2 for side in wall.size)),
        of_column=lambda c: Wall((c[0], c[1], c[2]), (2 * c[5], 2 * c[6], 2 * c[7]), math.atan2(c[4], c[3])),
        contact=_wall_contact,
        outline=lambda wall: Outline("wall", "box", wall.position_w, wall.size, wall.yaw),
    ),
)


def kind_of(obstacle: Obstacle) -> SolidKind:
    """The kind of a solid."""
    return next(kind for kind in KINDS if isinstance(obstacle, kind.made_of))


def solid_columns(obstacles: Iterable[Obstacle]) -> dict[str, np.ndarray]:
    """By kind, the numbers of all solids of that kind [C, S]; nothing for kinds that are not there."""
    columns: dict[str, list[tuple[float, ...]]] = {}
    for obstacle in obstacles:
        kind = kind_of(obstacle)
        columns.setdefault(kind.name, []).append(kind.column(obstacle))
    return {name: np.array(rows).T for name, rows in columns.items()}


def solid_tables(variants: Sequence[Iterable[Obstacle]]) -> dict[str, np.ndarray]:
    """By kind, the numbers of all solids in each of some variants [V, S, C], filled up with some deep under ground."""
    tables = [solid_columns(obstacles) for obstacles in variants]
    largest: dict[str, np.ndarray] = {}
    for name, columns in ((name, columns) for table in tables for name, columns in table.items()):
        if name not in largest or columns.shape[1] > largest[name].shape[1]:
            largest[name] = columns
    return {
        name: np.array([_filled_up(table.get(name, columns[:, :0]), columns).T for table in tables], np.float32)
        for name, columns in largest.items()
    }


def _filled_up(columns: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """[C, S] of the columns and, up to as many as are in `largest`, some of those deep under ground."""
    more = largest[:, columns.shape[1] :].copy()
    more[2] = NOWHERE
    return np.concatenate([columns, more], axis=1)


def solids_of_columns(tables: Mapping[str, np.ndarray]) -> tuple[Obstacle, ...]:
    """The solids of `solid_columns`, without those that fill up."""
    return tuple(
        kind.of_column(column)
        for kind in KINDS
        for column in np.asarray(tables.get(kind.name, np.zeros((0, 0))), np.float64).T.tolist()
        if column[2] > NOWHERE / 2
    )


def outlines(obstacles: Iterable[Obstacle]) -> Iterator[Outline]:
    """What each solid looks like from outside."""
    return (kind_of(obstacle).outline(obstacle) for obstacle in obstacles)


def solid_faults(kind: SolidKind, table: object) -> list[str]:
    """Faults of one table of a kind of solid, each on its own."""
    if not isinstance(table, Mapping):
        return [f"must be a table, got {schema.spell(table)}"]
    faults = list(toml_file.key_faults(table, kind.keys, kind.required))
    return faults + list(schema.angle_faults(table, "yaw"))
