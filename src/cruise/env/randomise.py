"""Races that differ from what vehicle and track say: drawn at the start of each, inside the compiled program."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cruise.config import EXACT, OF_BODY_AND_AIR, Gate, Randomisation, SelfPlayConfig, Sensing, Track, Vehicle
from cruise.dynamics.parameters import Parameters, physics_of, remembering
from cruise.env.draw_sensing import Sensors, draw_sensed, sensors_of
from cruise.env.mixed import Fleet
from cruise.env.surroundings import GUST_PERIODS, Conditions, Gusts, MovedGates, SensorErrors, Surroundings
from cruise.errors import CruiseError
from cruise.racing.solids import solid_tables

NOISE = 0.5  # of a sensor's error, that is new at every step
SMALLEST, LARGEST = 0.45, 1.3  # of a track that a race reshapes, times what it was
NARROWER, WIDER = 0.7, 1.15  # of its openings, beside the root of that
LEAST_HALF_SIZE = 0.4  # [m]
SENSED = ("position_error", "velocity_error", "attitude_error", "rate_error")  # in the order of `SensorErrors`
Shape = tuple[int, ...]
# Fields of `Randomisation` by name, numbers or arrays over races [*B]; what is not there costs nothing.
Strengths = Mapping[str, Any]
Variants = Sequence[Sequence[Gate]]
MOVED = frozenset({"gate_shift", "gate_turn"})


def made_for_each(fleet: Fleet, randomisation: Randomisation) -> Fleet:
    """As `made_for`, of all drones or of each."""
    if isinstance(fleet, Vehicle):
        return made_for(fleet, randomisation)
    return tuple(made_for(vehicle, randomisation) for vehicle in fleet)


def made_for(vehicle: Vehicle, randomisation: Randomisation) -> Vehicle:
    """The vehicle, remembering commands for as long as the longest delay that may be drawn.

    Raises:
        CruiseError: a number is negative or not finite, a spread is 1 or more, or there is no airframe to differ.
    """
    check_randomisation(vehicle, randomisation)
    return remembering(vehicle, randomisation.extra_delay) if randomisation.extra_delay else vehicle


def rival_spreads(opponents: SelfPlayConfig) -> dict[str, float]:
    """From what range of vehicles opponents are drawn in training, by the names of `Randomisation`."""
    return {"mass_spread": opponents.opponent_mass_spread, "thrust_spread": opponents.opponent_thrust_spread}


def check_randomisation(vehicle: Vehicle, randomisation: Randomisation) -> None:
    """Raises CruiseError where `made_for` does."""
    for name, value in dataclasses.asdict(randomisation).items():
        if not (math.isfinite(value) and value >= 0):
            raise CruiseError(f"{name} must be 0 or more, not {value}")
        if name.endswith("_spread") and value >= 1:
            raise CruiseError(f"{name} must be below 1, not {value}: nothing would be left of what it spreads")
        if name in ("extra_idle", "extra_curve") and value >= 0.5:
            raise CruiseError(f"{name} must be below 0.5, not {value}: a share of what rotors give")
        if value and name not in vehicle.randomisable:
            raise CruiseError(f"{name} needs a vehicle with an airframe, and {vehicle.name!r} has none: leave it 0")


def perturbation(
    track: Track,
    vehicle: Fleet,
    randomisation: Randomisation,
    milder_share: float = 0.0,
    nominal_share: float = 0.0,
    sensing: Sensing = EXACT,
    rivals: Mapping[str, float] | None = None,
) -> Callable[[Array, Shape], Conditions] | None:
    """What `make_race_env` takes to draw races so; None where nothing is random.

    Of the races, `nominal_share` are as vehicle and track say; of the others `milder_share` are less random than
    `randomisation` says: all of it times one number from 0 to 1. `sensing` is the same in all of them.
    `rivals`, spreads by name, are how far all drones but the first differ, where that is farther: a range of vehicles.
    """
    others = {name: value for name, value in (rivals or {}).items() if value}
    sensors = sensors_of(sensing, (vehicle if isinstance(vehicle, Vehicle) else vehicle[0]).control_dt)
    strengths = {name: value for name, value in dataclasses.asdict(randomisation).items() if value}

    def draw(key: Array, shape: Shape) -> Conditions:
        drawn: Strengths = strengths
        if milder_share or nominal_share:
            key, part_key = jax.random.split(key)
            part = _part(milder_share, nominal_share, part_key, shape[1:])
            drawn = {name: value * part for name, value in strengths.items()}
        drawn = {**drawn, **{name: _wider(drawn.get(name, 0.0), spread, shape) for name, spread in others.items()}}
        return draw_conditions(track, vehicle, drawn, key, shape, sensors=sensors)

    return draw if strengths or track.variants or sensors or others else None


def _wider(strength: Any, spread: float, shape: Shape) -> Array:
    """The strength of the first drone, of all others at least `spread` [N *B]."""
    own = jnp.broadcast_to(jnp.asarray(strength, jnp.float32), shape)
    first = (np.arange(shape[0]) == 0).reshape(-1, *(1,) * (len(shape) - 1))
    return jnp.where(first, own, jnp.maximum(own, spread))


def _part(milder_share: float, nominal_share: float, key: Array, races: Shape) -> Array:
    """How much of the randomisation each race meets: all of it, any part as often, or none."""
    chosen, how_much, spared = jax.random.split(key, 3)
    milder = jax.random.uniform(chosen, races) < milder_share
    nominal = jax.random.uniform(spared, races) < nominal_share
    return jnp.where(nominal, 0.0, jnp.where(milder, jax.random.uniform(how_much, races), 1.0))


def draw_conditions(
    track: Track,
    vehicle: Fleet,
    strengths: Strengths,
    key: Array,
    shape: Shape,
    offsets: Strengths | None = None,
    sensors: Sensors | None = None,
) -> Conditions:
    """Races of drones of `shape` (N, *B), as strongly random as `strengths` says.

    `offsets`, by the names of spreads, are relative deviations that are no chance: those of the middle of each spread.
    `sensors` are what drones know the race by; None: they know it exactly.
    """
    parts = jax.random.split(key, 5)
    mapped, gates = _gates(track, strengths, parts[1], shape[1:])
    sensed = draw_sensed(sensors, mapped, len(track.gates), parts[4], shape) if sensors else None
    surroundings = Surroundings(
        gates=gates,
        gusts=_gusts(strengths, parts[2], shape[1:]),
        errors=_errors(strengths, parts[3], shape),
        sensed=sensed,
    )
    return Conditions(_parameters_of(vehicle, strengths, offsets or {}, parts[0], shape), surroundings)


def _parameters_of(fleet: Fleet, strengths: Strengths, offsets: Strengths, key: Array, shape: Shape) -> Parameters:
    """Those of every drone, about what its own vehicle has."""
    if isinstance(fleet, Vehicle):
        return _parameters(fleet, strengths, offsets, key, shape)
    found = _parameters(fleet[0], strengths, offsets, key, shape)
    for other in dict.fromkeys(fleet[1:]):
        here = np.array([own == other for own in fleet]).reshape(-1, *(1,) * (len(shape) - 1))
        theirs = _parameters(other, strengths, offsets, key, shape)
        pairs = zip(found, theirs, strict=True)
        found = Parameters(*(_chosen(here, a, b) for a, b in pairs))
    return found


def _chosen(here: np.ndarray, ours: Any, theirs: Any) -> Any:
    """What is drawn for one of two vehicles alone, a drag that the other has not, is 0 for the other."""
    if ours is None and theirs is None:
        return None
    return jnp.where(here, 0.0 if theirs is None else theirs, 0.0 if ours is None else ours)


def _parameters(vehicle: Vehicle, strengths: Strengths, offsets: Strengths, key: Array, shape: Shape) -> Parameters:
    if OF_BODY_AND_AIR.isdisjoint(vehicle.randomisable):
        return Parameters()
    *others, of_firmware = jax.random.split(key, 12)
    keys = iter(others)
    built = physics_of(vehicle)

    def spread(value: Any, name: str) -> Any:
        """Evenly about `value`, drone by drone; None where it is as it should be."""
        key = next(keys)
        if name not in strengths and name not in offsets:
            return None
        chance = jax.random.uniform(key, jnp.shape(value)[:1] + shape, minval=-1.0, maxval=1.0)
        return value * (1 + offsets.get(name, 0.0) + strengths.get(name, 0.0) * chance)

    inertia = spread(jnp.asarray(built.inertia).reshape(3, *(1,) * len(shape)), "inertia_spread")
    delay, wind, clip = (strengths.get(name) for name in ("extra_delay", "wind_speed", "clip_share"))
    return Parameters(
        mass=spread(built.mass, "mass_spread"),
        inertia=inertia,
        thrust_gain=spread(1.0, "thrust_spread"),
        horizontal_drag=spread(built.horizontal_drag, "drag_spread"),
        vertical_drag=spread(built.vertical_drag, "drag_spread"),
        rotor_lag=spread(built.rotor_lag, "lag_spread"),
        rate_lag=spread(built.rate_lag, "lag_spread"),
        delay=None if delay is None else built.delay + delay * jax.random.uniform(next(keys), shape),
        wind_w=None if wind is None else _wind(wind, next(keys), shape),
        clip_share=None if clip is None else jnp.minimum(1.0, clip * jax.random.uniform(next(keys), shape)),
        quadratic_drag=spread(built.quadratic_drag, "drag_spread") if built.quadratic_drag else None,
        **_of_firmware(vehicle, strengths, of_firmware, shape),
    )


def _of_firmware(vehicle: Vehicle, strengths: Strengths, key: Array, shape: Shape) -> dict[str, Array]:
    """What real flight controllers and motors have beyond the vehicle's own: evenly from nothing on."""
    assert vehicle.airframe is not None
    rotors, rates = vehicle.airframe.rotors, vehicle.airframe.rates
    found = {}
    for number, (name, own, scale, parameter) in enumerate(
        (
            ("extra_integral", rates.integral_gain, 1.0, "integral_gain"),
            ("extra_idle", rotors.min_thrust, rotors.max_thrust, "min_thrust"),
            ("extra_curve", rotors.thrust_curve, 1.0, "thrust_curve"),
        )
    ):
        if name in strengths:
            chance = jax.random.uniform(jax.random.fold_in(key, number), shape)
            found[parameter] = own + strengths[name] * scale * chance
    return found


def _wind(strongest: Array | float, key: Array, shape: Shape) -> Array:
    """Level, from anywhere, of every strength up to `strongest`, the same for all drones of a race [m/s]."""
    how_strong, from_where = jax.random.split(key)
    speed = strongest * jax.random.uniform(how_strong, shape[1:])
    angle = jax.random.uniform(from_where, shape[1:], maxval=2 * jnp.pi)
    wind = jnp.stack([speed * jnp.cos(angle), speed * jnp.sin(angle), jnp.zeros_like(speed)])
    return jnp.broadcast_to(wind[:, None], (3, *shape))


def _gates(track: Track, strengths: Strengths, key: Array, races: Shape) -> tuple[MovedGates | None, MovedGates | None]:
    """Gates as the map has them and as they stand: of the track or one of its variants; shifted and turned.

    None: as the track says. None stands lower than its opening reaches. Gates that move do so about there.
    """
    moved, tilted, shifted = (not names.isdisjoint(strengths) for names in (MOVED, {"gate_tilt"}, {"solid_shift"}))
    if not (moved or tilted or shifted or track.variants or track.moves):
        return None, None
    shift_key, turn_key, variant_key, tilt_key, solids_key, shape_key = jax.random.split(key, 6)
    variants = track.variants or (track.gates,)
    variant = jax.random.randint(variant_key, races, 0, len(variants))
    position, yaw = _standing(variants, variant)
    half_size = None
    if track.reshaped:
        position, yaw, half_size = reshaped(track, position, yaw, shape_key)
    solids = _solids(track, variant) if shifted or track.variant_obstacles else None
    mapped = MovedGates(position, jnp.stack([jnp.cos(yaw), jnp.sin(yaw)]), solids=solids if shifted else None)
    if moved:
        gates = len(track.gates)
        shift = strengths.get("gate_shift", 0.0) * jax.random.uniform(shift_key, (3, gates, *races), minval=-1.0)
        turn = strengths.get("gate_turn", 0.0) * jax.random.uniform(turn_key, (gates, *races), minval=-1.0)
        half_height = jnp.array([gate.height / 2 for gate in track.gates]).reshape(gates, *(1,) * len(races))
        lowest = jnp.minimum(position[2], half_height if half_size is None else half_size[1])
        position, yaw = (position + shift).at[2].max(lowest), yaw + turn
    tilt = _tilts(variants, variant, strengths.get("gate_tilt"), tilt_key)
    if shifted and solids is not None:
        solids = _shifted(solids, strengths["solid_shift"], solids_key)
    return mapped, MovedGates(position, jnp.stack([jnp.cos(yaw), jnp.sin(yaw)]), half_size, tilt, solids)


def _standing(variants: Variants, variant: Array) -> tuple[Array, Array]:
    """Centres [3, G, *B] and yaws [G, *B] of the gates of every race's variant."""
    position = jnp.array([[gate.position_w for gate in gates] for gates in variants], jnp.float32)
    yaw = jnp.array([[gate.yaw for gate in gates] for gates in variants], jnp.float32)
    return position.T[:, :, variant], yaw.T[:, variant]


def _tilts(variants: Variants, variant: Array, largest: Any, key: Array) -> Array | None:
    """As `Course.tilt`, [4, G, *B]; None where it is the same in all races."""
    turns = np.array([[(gate.pitch, gate.roll) for gate in gates] for gates in variants], np.float32)
    if largest is None and (turns == turns[:1]).all():
        return None
    pitch, roll = jnp.asarray(turns.T)[:, :, variant] + (0.0 if largest is None else largest) * jax.random.uniform(
        key, (2, turns.shape[1], *variant.shape), minval=-1.0
    )
    return jnp.stack([jnp.cos(pitch), jnp.sin(pitch), jnp.cos(roll), jnp.sin(roll)])


def _solids(track: Track, variant: Array) -> dict[str, Array] | None:
    """As `Course.solids`, [C, S, *B] of each kind, as the map has them; None where there are none.

    Of a kind of which a variant has fewer than another, the rest lies where nobody flies.
    """
    every = track.variant_obstacles or (track.obstacles,)
    if not any(every):
        return None
    return {kind: jnp.asarray(table.T)[:, :, variant] for kind, table in solid_tables(every).items()}


def _shifted(tables: dict[str, Array], largest: Any, key: Array) -> dict[str, Array]:
    """The same, each solid moved by up to `largest` [m] along x and y."""
    moved = {}
    for number, (kind, table) in enumerate(tables.items()):
        shift = jax.random.uniform(jax.random.fold_in(key, number), (2, *table.shape[1:]), minval=-1.0)
        moved[kind] = table.at[:2].add(largest * shift)
    return moved


def reshaped(
    track: Track, position: Float[Array, "3 G *B"], yaw: Float[Array, "G *B"], key: Array
) -> tuple[Array, Array, Array]:
    """Each race's track smaller or larger, half of them mirrored, half flown the other way; and half sizes [2, G, *B].

    What could be flown still can be: a way through the gates is mirrored, reversed and stretched with them. Openings
    shrink and grow with the track, and each by itself.
    """
    gates, *races = yaw.shape
    scale_key, size_key, mirror_key, turn_key = jax.random.split(key, 4)
    scale = jnp.exp(jax.random.uniform(scale_key, races, minval=math.log(SMALLEST), maxval=math.log(LARGEST)))
    mirror = jnp.where(jax.random.bernoulli(mirror_key, 0.5, races), -1.0, 1.0)
    turn = jax.random.bernoulli(turn_key, 0.5, races)
    sizes = jnp.array([[gate.width / 2, gate.height / 2] for gate in track.gates]).T.reshape(
        2, gates, *(1,) * len(races)
    )
    wider = jax.random.uniform(size_key, (1, gates, *races), minval=NARROWER, maxval=WIDER)
    half_size = jnp.maximum(sizes * wider * jnp.sqrt(scale), LEAST_HALF_SIZE)
    position = position * scale
    position = jnp.stack([position[0], mirror * position[1], jnp.maximum(position[2], half_size[1])])
    yaw = mirror * yaw
    position, yaw, half_size = (jnp.where(turn, jnp.flip(x, -1 - len(races)), x) for x in (position, yaw, half_size))
    return position, jnp.where(turn, yaw + math.pi, yaw), half_size


def _gusts(strengths: Strengths, key: Array, races: Shape) -> Gusts | None:
    if "gust_speed" not in strengths:
        return None
    phase = jax.random.uniform(key, (3, len(GUST_PERIODS), *races), maxval=2 * jnp.pi)
    return Gusts(jnp.broadcast_to(jnp.asarray(strengths["gust_speed"], jnp.float32), races), phase)


def _errors(strengths: Strengths, key: Array, shape: Shape) -> SensorErrors | None:
    if not any(name in strengths for name in SENSED):
        return None
    bias_key, noise_key = jax.random.split(key)
    races = shape[1:]
    deviations = [jnp.broadcast_to(jnp.asarray(strengths.get(name, 0.0), jnp.float32), races) for name in SENSED]
    scale = jnp.repeat(jnp.stack(deviations), 3, axis=0)[:, None]
    bias = scale * jax.random.normal(bias_key, (scale.shape[0], *shape))
    return SensorErrors(
        bias, jnp.broadcast_to(NOISE * scale, bias.shape), jax.random.bits(noise_key, (2, *races), jnp.uint32)
    )
