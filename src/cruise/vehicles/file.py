"""Vehicles as TOML files, and every fault a vehicle file can have. Plain Python: no JAX.

A file names a vehicle to start from (`base = "racer"`) and what is other in its own, or gives mass, inertia and rotors
itself. Units stand in the names of the keys; `docs/vehicles.md` lists them, `cruise.vehicles.schema` declares them.
"""

import os
from collections.abc import Iterator

from cruise.config import Vehicle
from cruise.errors import CruiseError
from cruise.files import write_whole
from cruise.toml_file import FileKind, StrPath, Table, key_faults, read_toml, reason, refuse, shown, spell, unknown
from cruise.vehicles import schema
from cruise.vehicles.checks import check_vehicle, vehicle_faults
from cruise.vehicles.document import from_document, to_text
from cruise.vehicles.named import VEHICLES

KIND = FileKind("vehicle", VEHICLES)
VehicleChoice = Vehicle | str | os.PathLike[str]  # itself, the name of a built-in one, or the path of a TOML file


def load_vehicle(choice: VehicleChoice) -> Vehicle:
    """Give a vehicle as it is, a built-in one by name, or that of a TOML file.

    A built-in name wins over a file of that name; write `./racer` for the file.

    Raises:
        CruiseError: no such vehicle, an unreadable file, or a vehicle that cannot fly; names the first faults.
    """
    if isinstance(choice, Vehicle):
        check_vehicle(choice)
        return choice
    if isinstance(choice, str) and choice in VEHICLES:
        return VEHICLES[choice]
    document = read_toml(choice, KIND)
    refuse(document_faults(document), shown(choice), KIND.noun)
    return from_document(document, VEHICLES)


def save_vehicle(vehicle: Vehicle, path: StrPath) -> None:
    """Write a vehicle as TOML with a comment on every number, whole or not at all; `load_vehicle` gives it back.

    Raises:
        CruiseError: it cannot fly, it has the name of a built-in one and is another, or the file cannot be written.
    """
    refuse([*vehicle_faults(vehicle), *_name_faults(vehicle)], f"vehicle {spell(vehicle.name)}", KIND.noun)
    write_text(path, to_text(vehicle))


def write_text(path: StrPath, text: str) -> None:
    """Write a vehicle file. Raises CruiseError where that cannot be done."""
    try:
        write_whole(path, text.encode())
    except (OSError, ValueError) as error:
        raise CruiseError(f"{shown(path)}: cannot be written: {reason(error)}") from error


def file_faults(path: StrPath) -> list[str]:
    """Every fault of a vehicle file, one line each. Raises CruiseError where there is no TOML to look at."""
    return document_faults(read_toml(path, KIND))


def document_faults(document: Table) -> list[str]:
    """Every fault of a vehicle file's content; what follows from its numbers is looked at where each is sound."""
    faults = list(_base_faults(document))
    own = {key: value for key, value in document.items() if key not in (*schema.TABLES, "base")}
    required = {"": schema.REQUIRED} if "base" in document else schema.REQUIRED_WITHOUT_BASE
    head = {name: key.check for name, key in schema.keys_of("").items()}
    faults += key_faults(own, head | dict.fromkeys(("base", *schema.TABLES), _anything), required.get("", {}))
    for table in schema.TABLES:
        if table in document or table in required:
            faults += _table_faults(table, document.get(table, {}), required.get(table, {}))
    if faults:
        return faults
    vehicle = from_document(document, VEHICLES)
    return [*vehicle_faults(vehicle), *_name_faults(vehicle)]


def _anything(value: object) -> str:
    """No fault: the value is looked at elsewhere."""
    return ""


def _base_faults(document: Table) -> Iterator[str]:
    if "base" not in document:
        if "cascade" in document:
            yield 'cascade: only the paper\'s vehicle has these gains: start from it with base = "paper"'
        return
    base = document["base"]
    if not isinstance(base, str):
        yield f"base must be the name of a built-in vehicle in quotes, got {spell(base)}"
    elif base not in VEHICLES:
        yield f"base: {unknown(base, KIND)}"
    else:
        for table in schema.TABLES:
            needs = "rotors" if table in schema.OF_THE_ROTORS else "cascade" if table == "cascade" else None
            if table in document and needs not in (None, VEHICLES[base].flown_by):
                yield f"{table}: base {base!r} has no {needs}: leave this table out, or start from another vehicle"


def _table_faults(table: str, content: object, required: Table) -> Iterator[str]:
    if not isinstance(content, dict):
        yield f"{table} must be a table [{table}], got {spell(content)}"
        return
    checks = {name: key.check for name, key in schema.keys_of(table).items()}
    for fault in key_faults(content, checks, required):
        yield f"{table}: {fault}"


def _name_faults(vehicle: Vehicle) -> Iterator[str]:
    """A log or a policy that says `racer` must mean the built-in one."""
    if vehicle.name in VEHICLES and VEHICLES[vehicle.name] != vehicle:
        yield f"name {vehicle.name!r} is that of a built-in vehicle with other numbers: choose another"
