"""What a vehicle file says as a `Vehicle`, and back. Plain Python: no JAX."""

import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import tomli_w

from cruise.config import Airframe, Battery, Rotors, Vehicle
from cruise.toml_file import Table
from cruise.vehicles import schema

# What a file without a base starts from: flown by thrust and body rates; its own numbers are all required.
_BLANK = Vehicle(
    control_dt=0.02,
    integrator="midpoint",
    substeps=5,
    source="vehicle file",
    control="ctbr",
    flip_ends=False,
    airframe=Airframe(Rotors(offset=(0.1, 0.1), torque_ratio=0.02, max_thrust=1.0), longest_delay=0.02),
)


def from_document(document: Table, bases: Mapping[str, Vehicle]) -> Vehicle:
    """The vehicle of a document without faults, whose base is one of `bases`."""
    vehicle = bases[document["base"]] if "base" in document else _BLANK
    if "base" in document and "source" not in document:
        vehicle = replace(vehicle, source=f"vehicle file, from {document['base']}")
    if "battery" in document and vehicle.airframe is not None and vehicle.airframe.battery is None:
        vehicle = replace(vehicle, airframe=replace(vehicle.airframe, battery=Battery()))
    for key in schema.KEYS:
        table = document.get(key.table, {}) if key.table else document
        if key.name in table:
            vehicle = _with(vehicle, key.place.split("."), table[key.name])
    return vehicle if "agility_m_s2" in document else _with_all_thrust(vehicle, document)


def _with_all_thrust(vehicle: Vehicle, document: Table) -> Vehicle:
    """With the thrust of all rotors as the highest that is asked for, where mass or rotors are its own."""
    own = "mass_kg" in document or "max_thrust_n" in document.get("rotors", {})
    if vehicle.airframe is None or not own:
        return vehicle
    return replace(vehicle, agility=4 * vehicle.airframe.rotors.max_thrust / vehicle.mass)


def _with(part: Any, place: list[str], value: Any) -> Any:
    """A dataclass with one attribute of it, or of a part of it, changed."""
    name, *rest = place
    if rest:
        return replace(part, **{name: _with(getattr(part, name), rest, value)})
    if isinstance(value, list):
        value = tuple(float(one) for one in value)
    elif isinstance(value, int) and not isinstance(getattr(part, name), int):
        value = float(value)
    return replace(part, **{name: value})


def to_text(vehicle: Vehicle, comments: dict[str, str] | None = None) -> str:
    """The file of a vehicle, with what every key means behind it; `comments` say more, by the key's place."""
    comments = comments or {}
    cascade = vehicle.flown_by == "cascade"
    lines = ['base = "paper"  # flown by its cascade'] if cascade else []
    for table in ("", *schema.TABLES):
        rows = [(key, value_at(vehicle, key.place)) for key in schema.keys_of(table).values()]
        rows = [(key, value) for key, value in rows if value is not None]
        if not rows or (table == "cascade" and not cascade):
            continue
        lines += ["", f"[{table}]"] if table else []
        lines += [f"{_line(key.name, value)}  # {comments.get(key.place, key.meaning)}" for key, value in rows]
    return "\n".join(lines) + "\n"


def value_at(vehicle: Vehicle, place: str) -> Any:
    """What stands at a place; None where there is no such part."""
    return functools.reduce(lambda part, name: None if part is None else getattr(part, name), place.split("."), vehicle)


def _line(name: str, value: Any) -> str:
    if isinstance(value, tuple):
        return f"{name} = [{', '.join(_line('x', one).removeprefix('x = ') for one in value)}]"
    return tomli_w.dumps({name: value}).strip()
