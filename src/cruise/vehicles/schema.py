"""What may stand in a vehicle file: each key once, with its place in `Vehicle`, its check and what it means."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

from cruise import toml_file
from cruise.actions import Control, YawControl
from cruise.config import Integrator
from cruise.toml_file import Check

LIMIT = 1e6  # largest number of a vehicle, whatever its unit


def _positive(value: object) -> str:
    return toml_file.positive(value, LIMIT)


def _not_negative(value: object) -> str:
    return toml_file.not_negative(value, LIMIT)


def _each_positive(*names: str) -> Check:
    return functools.partial(toml_file.numbers, names=names, check=_positive)


def _one_of(kind: Any) -> Check:
    return functools.partial(toml_file.choice, known=get_args(kind))


@dataclass(frozen=True)
class Key:
    """One number or word of a vehicle file."""

    table: str  # it stands in; "" for the head of the file
    name: str  # with its unit
    place: str  # attribute of `Vehicle`
    check: Check
    meaning: str


def _keys(table: str, place: str, *rows: tuple[str, str, Check, str]) -> tuple[Key, ...]:
    return tuple(Key(table, name, place + attribute, check, meaning) for name, attribute, check, meaning in rows)


_WHOLE = functools.partial(toml_file.whole, low=1, high=1000)
_AXES = _each_positive("x", "y", "z")

KEYS: tuple[Key, ...] = (
    *_keys(
        "",
        "",
        ("name", "name", toml_file.label, "what tables and logs call it"),
        ("source", "source", toml_file.label, "where the numbers come from"),
        ("mass_kg", "mass", _positive, "of all that flies, battery included"),
        ("inertia_kg_m2", "inertia", _AXES, "principal moments about x (forward), y (left), z (up)"),
        ("gravity_m_s2", "gravity", _positive, "where it flies"),
        ("control", "control", _one_of(Control), f"what an action means: {', '.join(get_args(Control))}"),
        ("agility_m_s2", "agility", _positive, "scale of the action; with rotors the highest thrust per mass"),
        ("control_period_s", "control_dt", _positive, "from one action to the next"),
        ("substeps", "substeps", _WHOLE, "integration steps in one control period"),
        ("integrator", "integrator", _one_of(Integrator), ", ".join(get_args(Integrator))),
        ("collision_distance_m", "collision_distance", _positive, "two drones nearer than this have collided"),
        ("collision_aspect", "collision_aspect", _positive, "height per width of that ellipsoid; 1: a sphere"),
        ("flip_ends", "flip_ends", toml_file.flag, "rolling or pitching past 90 degrees is a crash"),
        ("indoors", "indoors", toml_file.flag, "full randomisation brings a draught, not a breeze"),
    ),
    *_keys(
        "rotors",
        "airframe.rotors.",
        ("offset_m", "offset", _each_positive("forward", "sideways"), "of every rotor from the centre"),
        ("torque_ratio_m", "torque_ratio", _positive, "reaction torque per thrust"),
        ("max_thrust_n", "max_thrust", _positive, "of one rotor"),
        ("min_thrust_n", "min_thrust", _not_negative, "of one rotor"),
        ("time_constant_s", "time_constant", _not_negative, "first-order lag of the thrust; 0: none"),
        ("radius_m", "radius", _positive, "of a propeller"),
        ("saturate", "saturate", toml_file.flag, "false: as if rotors had no limits"),
        ("thrust_curve", "thrust_curve", _not_negative, "how far thrust goes with the square of the command, 0 to 1"),
    ),
    *_keys(
        "rates",
        "airframe.rates.",
        ("time_constant_s", "time_constant", _positive, "of the body-rate loop, without rotor lag"),
        ("max_rates_rad_s", "highest", _each_positive("roll", "pitch", "yaw"), "that can be commanded"),
        ("integral_1_s", "integral_gain", _not_negative, "gain of its integral, per gain of the error; 0: none"),
    ),
    *_keys(
        "attitude",
        "airframe.attitude.",
        ("max_tilt_rad", "highest_tilt", _positive, "roll and pitch that can be commanded, below 1.57"),
        ("yaw", "yaw", _one_of(YawControl), "an action says how fast to yaw (rate), or where to (angle)"),
        ("max_yaw_rad", "highest_yaw", _positive, "that can be commanded as an angle, at most 3.1416"),
    ),
    *_keys(
        "drag",
        "airframe.drag.",
        ("horizontal_kg_s", "horizontal", _not_negative, "linear, in the plane of the rotors"),
        ("vertical_kg_s", "vertical", _not_negative, "linear, along the thrust"),
        ("quadratic_kg_m", "quadratic", _not_negative, "along the airspeed"),
    ),
    *_keys(
        "effects",
        "airframe.",
        ("delay_s", "delay", _not_negative, "from an action to its effect; 0: none"),
        ("longest_delay_s", "longest_delay", _not_negative, "that randomisation may ask for"),
        ("downwash", "downwash", toml_file.flag, "the air that rotors push down moves the drones below"),
    ),
    *_keys(
        "battery",
        "airframe.battery.",
        ("capacity_a_s", "capacity", _positive, "charge; 3600 A s are 1 A h"),
        ("full_voltage_v", "full_voltage", _positive, "at rest"),
        ("empty_voltage_v", "empty_voltage", _positive, "at rest"),
        ("resistance_ohm", "resistance", _not_negative, "internal"),
        ("efficiency", "efficiency", _positive, "ideal power of hovering rotors per electric power"),
    ),
    *_keys(
        "tracking",
        "tracking.",
        ("position_gain_1_s", "position_gain", _positive, "of the position loop of planners and scripted pilots"),
        ("velocity_gain_1_s", "velocity_gain", _positive, "of the velocity loop"),
        ("attitude_gain_1_s", "attitude_gain", _positive, "of the attitude loop"),
        ("speed_m_s", "speed", _positive, "a velocity reference at full deflection"),
        ("reach_m", "reach", _positive, "a position reference at full deflection: so far from the drone"),
    ),
    *_keys(
        "cascade",
        "controller.",
        ("velocity_p_1_s", "velocity_p", _not_negative, "gains of the paper's cascade, its Sec. 3.1.2"),
        ("velocity_d_1_s", "velocity_d", _not_negative, "on the change of the velocity error"),
        ("position_p", "position_p", _not_negative, "K_p,pos"),
        ("position_d_1_s", "position_d", _not_negative, "K_d,pos"),
        ("attitude_p_n_m_rad", "attitude_p", _not_negative, "K_p,att"),
        ("attitude_d_n_m_s_rad", "attitude_d", _not_negative, "K_d,att"),
    ),
)
TABLES: tuple[str, ...] = tuple(dict.fromkeys(key.table for key in KEYS if key.table))
OF_THE_ROTORS = frozenset(key.table for key in KEYS if key.place.startswith("airframe."))

REQUIRED = {"name": 'the vehicle\'s name, as in name = "my racer"'}
REQUIRED_WITHOUT_BASE: Mapping[str, Mapping[str, str]] = {
    "": REQUIRED
    | {
        "mass_kg": 'its mass, as in mass_kg = 0.75; or start from a vehicle there is: base = "racer"',
        "inertia_kg_m2": "its principal moments, as in inertia_kg_m2 = [0.0025, 0.0021, 0.0043]",
    },
    "rotors": {
        "offset_m": "forward and sideways from the centre, as in offset_m = [0.08, 0.1]",
        "torque_ratio_m": "reaction torque per thrust, as in torque_ratio_m = 0.02",
        "max_thrust_n": "of one rotor, as in max_thrust_n = 6",
    },
}


def keys_of(table: str) -> dict[str, Key]:
    """The keys of a table by name, in order."""
    return {key.name: key for key in KEYS if key.table == table}
