"""Sensors of races that begin, by a configuration: drawn inside the compiled program."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cruise.config import Sensing
from cruise.env.sensing import Gates, Look, Opponents, Sensed, Sensor
from cruise.errors import CruiseError

LONGEST = 1.0  # latency, and delay of the radio [s]


class Sensors(NamedTuple):
    """What all races have: numbers, or arrays over races [*B], by the names that `sensors_of` gives."""

    numbers: Mapping[str, Any]
    depth: int  # looks that are kept, the longest time that one takes to be known


def sensors_of(sensing: Sensing, control_dt: float) -> Sensors | None:
    """The sensors of a vehicle that is told something every `control_dt` [s]; None where everything is known.

    Raises:
        CruiseError: a number makes no sense.
    """
    check_sensing(sensing)
    if sensing.sensing == "exact":
        return None
    latency, radio_delay = (round(time / control_dt) for time in (sensing.sensor_latency, sensing.radio_delay))
    numbers = {
        "reach": sensing.sensor_range,
        "all_round": sensing.sensing == "range",
        "tilt": sensing.camera_tilt,
        "width": sensing.camera_width,
        "height": sensing.camera_height,
        "period": max(1, round(1 / (sensing.sensor_rate * control_dt))),
        "latency": latency,
        "radio": sensing.opponents_by == "radio",
        "radio_delay": radio_delay,
        "control_dt": control_dt,
        "bias": sensing.velocity_bias,
        "scale": sensing.drift_share,
        "fix_error": sensing.fix_error,
    }
    return Sensors(numbers, 1 + max(latency, radio_delay if sensing.opponents_by == "radio" else 0))


def together(sensors: list[Sensors]) -> Sensors:
    """Sensors of as many kinds of races, one number of each kind in every array."""
    numbers = {name: np.array([one.numbers[name] for one in sensors]) for name in sensors[0].numbers}
    return Sensors(numbers, max(one.depth for one in sensors))


def check_sensing(sensing: Sensing) -> None:
    """Raises CruiseError with the first number that makes no sense."""
    for fault in _faults(sensing):
        raise CruiseError(fault)


def _faults(sensing: Sensing) -> Iterator[str]:
    for name in ("velocity_bias", "drift_share", "fix_error"):
        value = getattr(sensing, name)
        if not (math.isfinite(value) and value >= 0):
            yield f"{name} must be 0 or more, not {value}"
    for name in ("sensor_range", "sensor_rate"):
        value = getattr(sensing, name)
        if not (math.isfinite(value) and value > 0):
            yield f"{name} must be above 0, not {value}"
    for name in ("sensor_latency", "radio_delay"):
        value = getattr(sensing, name)
        if not 0 <= value <= LONGEST:
            yield f"{name} must be from 0 to {LONGEST:g} s, not {value}"
    for name in ("camera_width", "camera_height"):
        value = getattr(sensing, name)
        if not 0 < value < math.pi:
            yield f"{name} must be between 0 and {math.pi:.2f} rad, not {value}"
    if not abs(sensing.camera_tilt) <= math.pi / 2:
        yield f"camera_tilt must be from {-math.pi / 2:.2f} to {math.pi / 2:.2f} rad, not {sensing.camera_tilt}"


def draw_sensed(sensors: Sensors, mapped: Any, gates: int, key: Array, shape: tuple[int, ...]) -> Sensed:
    """Sensors of races of drones of `shape` (N, *B) on so many gates, and nothing known yet but the map.

    `mapped` is where the map of each race has the gates, `None` where they are nowhere else.
    """
    drones, *races = shape
    numbers = {name: jnp.broadcast_to(jnp.asarray(value), races) for name, value in sensors.numbers.items()}
    bias_key, scale_key, noise_key = jax.random.split(key, 3)

    def spread(name: str, key: Array) -> Array:
        return numbers[name] * jax.random.uniform(key, (3, *shape), minval=-1.0, maxval=1.0)

    plain = {name: numbers[name] for name in Sensor._fields if name in numbers}
    sensor = Sensor(**plain | {
        "tilt": jnp.stack([jnp.cos(numbers["tilt"]), jnp.sin(numbers["tilt"])]),
        "half_view": jnp.tan(jnp.stack([numbers["width"], numbers["height"]]) / 2),
        "bias": spread("bias", bias_key),
        "scale": spread("scale", scale_key),
        "key": jax.random.bits(noise_key, (2, *races), jnp.uint32),
    })  # fmt: skip
    vector, others = jnp.zeros((3, *shape)), (drones - 1, *shape)
    seen = Opponents(jnp.zeros((3, *others)), jnp.zeros((3, *others)), jnp.zeros(others, bool))
    solids = {} if mapped is None else mapped.solids or {}
    look = Look(
        jnp.zeros((gates, *shape), bool),
        {kind: jnp.zeros((table.shape[1], *shape), bool) for kind, table in solids.items()},
        jnp.zeros(others, bool),
        vector,
        vector,
        jnp.zeros(shape, bool),
        vector,
        vector,
    )
    past = jax.tree.map(lambda one: jnp.broadcast_to(one, (sensors.depth, *one.shape)), look)
    return Sensed(sensor, past, vector, None if mapped is None else _believed(mapped, shape), seen)


def _believed(mapped: Any, shape: tuple[int, ...]) -> Gates:
    """Every drone believes the map."""
    return Gates(*(
        jax.tree.map(lambda table: jnp.broadcast_to(table[:, :, None], (*table.shape[:2], *shape)), places)
        for places in (mapped.position_w, mapped.normal_w, mapped.solids)
    ))  # fmt: skip
