"""Vehicles: named ones, those of TOML files, and what must hold for them. Plain Python: no JAX."""

from cruise.vehicles.checks import check_vehicle, vehicle_faults
from cruise.vehicles.file import VehicleChoice, load_vehicle, save_vehicle
from cruise.vehicles.named import (
    BATTERIES,
    VEHICLES,
    find_vehicle,
    fly_alike,
    name_of,
    reference_to,
    with_thrust_to_weight,
)

__all__ = [
    "BATTERIES",
    "VEHICLES",
    "VehicleChoice",
    "check_vehicle",
    "find_vehicle",
    "fly_alike",
    "load_vehicle",
    "name_of",
    "reference_to",
    "save_vehicle",
    "vehicle_faults",
    "with_thrust_to_weight",
]
