"""Vehicle files: every fault is named, a saved vehicle comes back equal, nothing is half written."""

import math
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import pytest

import cruise
from cruise.config import AttitudeLimits, Battery, Vehicle
from cruise.errors import CruiseError
from cruise.toml_file import SHOWN_FAULTS
from cruise.vehicles import BATTERIES, VEHICLES, fly_alike, load_vehicle, reference_to, save_vehicle, schema
from cruise.vehicles.document import to_text, value_at
from cruise.vehicles.file import document_faults, file_faults
from cruise.vehicles.named import SHIPPED
from tests.vehicles.tables import HEAVY, MALFORMED, OWN, UNREADABLE

RACER = VEHICLES["racer"]
EXAMPLES = sorted([*(Path(__file__).parents[2] / "examples" / "vehicles").glob("*.toml"), *SHIPPED.glob("*.toml")])


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "vehicle.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("case", MALFORMED)
def test_every_fault_is_named(case, tmp_path):
    content, expected = MALFORMED[case]
    path = write(tmp_path, content)
    faults = file_faults(path)
    assert len(faults) == len(expected), faults
    assert all(fault.startswith(text) for fault, text in zip(faults, expected, strict=True)), faults
    with pytest.raises(CruiseError) as caught:
        load_vehicle(path)
    assert str(caught.value).startswith(f"{path}: {'; '.join(faults[:SHOWN_FAULTS])}")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("case", UNREADABLE)
def test_unreadable_content_is_refused(case, tmp_path):
    content, expected = UNREADABLE[case]
    path = write(tmp_path, content)
    with pytest.raises(CruiseError) as caught:
        load_vehicle(path)
    assert str(caught.value).startswith(f"{path}: {expected}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        (
            "racr",
            f"unknown vehicle 'racr': did you mean 'racer'? built-in vehicles: {', '.join(VEHICLES)}; or",
        ),
        ("missing.toml", "missing.toml: no such vehicle file"),
        (Path("racer"), "racer: no such vehicle file"),
        (".", ".: is a directory, not a vehicle file"),
        (replace(RACER, mass=-1.0), "vehicle 'racer': mass must be positive, not -1.0"),
    ],
)
def test_what_is_no_vehicle_is_named(choice, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CruiseError) as caught:
        load_vehicle(choice)
    assert str(caught.value).startswith(expected)


EVERYTHING = replace(
    RACER,
    name="$every \\ \"thing'",
    control="attitude",
    indoors=True,
    airframe=replace(
        RACER.airframe,
        attitude=AttitudeLimits(0.3, "angle"),
        battery=replace(BATTERIES["racer"], resistance=0.1),
        downwash=True,
        delay=0.013,
    ),
)


@pytest.mark.parametrize("vehicle", [*VEHICLES.values(), EVERYTHING, replace(VEHICLES["paper"], name="p", mass=1 / 3)])
def test_a_saved_vehicle_comes_back_equal(vehicle, tmp_path):
    path = tmp_path / "saved.toml"
    save_vehicle(vehicle, path)
    assert load_vehicle(path) == vehicle
    assert cruise.load_vehicle(vehicle) is vehicle


def test_a_vehicle_that_cannot_fly_is_not_saved(tmp_path):
    with pytest.raises(CruiseError, match="name 'racer' is that of a built-in vehicle"):
        save_vehicle(replace(RACER, mass=0.8), tmp_path / "x.toml")
    with pytest.raises(CruiseError, match="cannot be written: No such file or directory"):
        save_vehicle(RACER, tmp_path / "nowhere" / "x.toml")
    assert not list(tmp_path.iterdir())


def leaves(part: object, place: str = "") -> set[str]:
    """Every number of a dataclass, as the schema spells its place."""
    found = set()
    for field in fields(part):
        value = getattr(part, field.name)
        found |= leaves(value, f"{place}{field.name}.") if is_dataclass(value) else {place + field.name}
    return found


def test_every_number_of_a_vehicle_has_a_key():
    """A field that is added to `Vehicle` and forgotten in the schema would be lost in a file."""
    whole = replace(RACER, airframe=replace(RACER.airframe, battery=Battery()))
    assert {key.place for key in schema.KEYS} == leaves(whole)


def test_a_base_is_changed_where_the_file_says_so(tmp_path):
    heavy = load_vehicle(write(tmp_path, HEAVY + "[rates]\nmax_rates_rad_s = [8, 8, 2]\n"))
    assert (heavy.name, heavy.mass, heavy.source) == ("heavy", 1.0, "vehicle file, from racer")
    assert heavy.airframe.rates.highest == (8.0, 8.0, 2.0)
    assert heavy.airframe.rotors == RACER.airframe.rotors
    assert heavy.agility == pytest.approx(4 * RACER.airframe.rotors.max_thrust)  # all its thrust, per kilogram
    given = load_vehicle(write(tmp_path, HEAVY + "agility_m_s2 = 20\n"))
    assert given.agility == 20.0
    assert load_vehicle(write(tmp_path, 'name = "r"\nbase = "racer"\nsource = "x"\n')).agility == RACER.agility


def test_a_vehicle_without_a_base_has_its_own_numbers(tmp_path):
    own = load_vehicle(write(tmp_path, OWN))
    assert (own.flown_by, own.action.kind, own.agility) == ("rotors", "ctbr", 40.0)
    battery = load_vehicle(write(tmp_path, OWN + "[battery]\nresistance_ohm = 0.1\n")).airframe.battery
    assert battery == replace(Battery(), resistance=0.1)


def test_the_text_says_what_every_number_means():
    for line in to_text(RACER).splitlines():
        assert not line or line.startswith("[") or "  # " in line


def test_numbers_stay_finite_and_within_float32():
    assert not document_faults({"name": "x", "base": "racer", "mass_kg": 2})
    assert value_at(VEHICLES["paper"], "airframe.rates.highest") is None
    assert all(math.isfinite(vehicle.agility) for vehicle in VEHICLES.values())


def test_who_can_fly_whose_vehicle():
    heavy = replace(RACER, name="heavy", mass=1.0)
    assert fly_alike(RACER, heavy)
    assert fly_alike(RACER, VEHICLES["crazyflie"])
    assert not fly_alike(RACER, VEHICLES["paper"])
    assert not fly_alike(RACER, replace(RACER, control="attitude"))
    by_heading = replace(RACER.airframe, attitude=AttitudeLimits(yaw="angle"))
    assert not fly_alike(replace(RACER, control="attitude"), replace(RACER, control="attitude", airframe=by_heading))
    assert not fly_alike(VEHICLES["paper"], replace(RACER, control="acceleration"))


def test_a_reference_is_a_name_only_where_the_name_says_it_all():
    assert reference_to(RACER) == "racer"
    changed = replace(RACER, mass=1.0)
    assert reference_to(changed) is changed
    assert isinstance(cruise.Vehicle(), Vehicle)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_are_sound(path):
    assert file_faults(path) == []
    assert load_vehicle(path).name == path.stem
