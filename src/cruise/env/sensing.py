"""What drones know of gates, opponents and themselves: sightings, and what is left of them between two of them.

It lies in the state of a race, so that it is the same whoever flies. Nothing here exists where sensing is exact.
"""

import operator
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt32

from cruise.racing.field import all_opponents
from cruise.vector import fold, norm

if TYPE_CHECKING:
    from cruise.env.types import RaceState


class Gates(NamedTuple):
    """Where gates and solids stand, or are believed to by every drone: then with an axis N after G and S."""

    position_w: Float[Array, "3 G *B"]  # [m]
    normal_w: Float[Array, "2 G *B"]
    solids: dict[str, Float[Array, "C S *B"]] | None = None  # as `Course.solids`; None: they stand where the map says


class Opponents(NamedTuple):
    """Opponents 1 to N - 1 of every drone as it knows them: drone (i + k) mod N for drone i."""

    position_w: Float[Array, "3 K N *B"]  # [m]
    velocity_w: Float[Array, "3 K N *B"]  # [m/s]
    present: Bool[Array, "K N *B"]  # known, and in the air


class Sensor(NamedTuple):
    """What sensors are like in each race. Times are in control steps."""

    reach: Float[Array, "*B"]  # [m]
    all_round: Bool[Array, "*B"]  # sees to every side
    tilt: Float[Array, "2 *B"]  # cosine and sine of the camera's, upwards
    half_view: Float[Array, "2 *B"]  # tangents of half the horizontal and half the vertical field of view
    period: Int[Array, "*B"]  # between two looks
    latency: Int[Array, "*B"]
    radio: Bool[Array, "*B"]  # opponents out of sight tell where they are
    radio_delay: Int[Array, "*B"]
    control_dt: Float[Array, "*B"]  # [s]
    bias: Float[Array, "3 N *B"]  # of the velocity estimate [m/s]
    scale: Float[Array, "3 N *B"]  # of the velocity estimate, relative
    fix_error: Float[Array, "*B"]  # [m]
    key: UInt32[Array, "2 *B"]  # of the errors of fixes


class Look(NamedTuple):
    """What was to be seen at one moment, and where everyone was and believed to be."""

    gates: Bool[Array, "G N *B"]  # in sight
    solids: dict[str, Bool[Array, "S N *B"]]  # in sight, of kinds that may stand elsewhere than on the map
    opponents: Bool[Array, "K N *B"]  # in sight
    position_w: Float[Array, "3 N *B"]
    velocity_w: Float[Array, "3 N *B"]
    airborne: Bool[Array, "N *B"]
    error_w: Float[Array, "3 N *B"]  # of the position estimates, less what was corrected since
    told_w: Float[Array, "3 N *B"]  # the position estimates


class Sensed(NamedTuple):
    """The sensors of a race, and what is known by them."""

    sensor: Sensor
    past: Look  # of this and earlier steps, newest first, along a leading axis H
    error_w: Float[Array, "3 N *B"]  # of the position estimates [m]
    gates: Gates | None  # as believed; None: they are known to stand where the map has them
    seen: Opponents  # in sight at the last look, flying on since; the truth


def settled(
    sensed: Sensed, state: "RaceState", gates: Gates, told: Gates, rotation: Float[Array, "3 3 N *B"]
) -> Sensed:
    """What is known at the start, after standing there for a while; see `sensed_after`."""
    look = _look(sensed, state, gates, rotation)
    past = jax.tree.map(lambda one, all_of_them: jnp.broadcast_to(one, all_of_them.shape), look, sensed.past)
    return _informed(sensed._replace(past=past), state, told, jnp.ones_like(sensed.sensor.all_round))


def sensed_after(
    sensed: Sensed, state: "RaceState", gates: Gates, told: Gates, rotation: Float[Array, "3 3 N *B"]
) -> Sensed:
    """What is known after a control step that led to `state`.

    `gates` as they stand, `told` as they stood when the look was taken that arrives now, `rotation` R_WB of all drones.
    """
    velocity = state.drones.velocity_w
    dt = sensed.sensor.control_dt
    drifted = sensed.error_w + dt * velocity_error(sensed.sensor, velocity)
    seen = sensed.seen._replace(position_w=sensed.seen.position_w + dt * sensed.seen.velocity_w)
    sensed = sensed._replace(error_w=drifted, seen=seen)
    look = _look(sensed, state, gates, rotation)
    past = jax.tree.map(lambda one, before: jnp.concatenate([one[None], before[:-1]]), look, sensed.past)
    arrives = (state.step >= sensed.sensor.latency) & ((state.step - sensed.sensor.latency) % sensed.sensor.period == 0)
    return _informed(sensed._replace(past=past), state, told, arrives)


def _informed(sensed: Sensed, state: "RaceState", gates: Gates, arrives: Bool[Array, "*B"]) -> Sensed:
    """After a look `arrives`: where the gates in it stand, how wrong the drone's place was, who flew there."""
    sensor = sensed.sensor
    look = _ago(sensed.past, sensor.latency)
    in_sight = look.gates & arrives
    fixed = sensor.fix_error * _white(sensor, state.step, look.error_w.shape)
    correction = jnp.where(in_sight.any(axis=0), fixed - look.error_w, 0.0)
    past = sensed.past._replace(error_w=sensed.past.error_w + correction)  # looks on their way correct the rest alone
    believed = sensed.gates
    if believed is not None:
        believed = Gates(
            _corrected(gates.position_w, believed.position_w, in_sight),
            _corrected(gates.normal_w, believed.normal_w, in_sight),
            _solids_after(gates, believed, {kind: seen & arrives for kind, seen in look.solids.items()}),
        )
    age = sensor.latency * sensor.control_dt
    fresh = _flown_on(look, look.opponents & _opponents(look.airborne, 0), age)
    seen = jax.tree.map(lambda new, old: jnp.where(arrives, new, old), fresh, sensed.seen)
    return Sensed(sensor, past, sensed.error_w + correction, believed, seen)


def _corrected(true: Array, belief: Array, seen: Array) -> Array:
    """What is believed of gates or solids [C, G, N, *B], of those `seen` the truth."""
    return jnp.where(seen, _for_each_drone(true, belief.ndim), belief)


def _solids_after(gates: Gates, believed: Gates, seen: dict[str, Array]) -> dict[str, Array] | None:
    if believed.solids is None or gates.solids is None:
        return None
    return {kind: _corrected(gates.solids[kind], belief, seen[kind]) for kind, belief in believed.solids.items()}


def velocity_error(sensor: Sensor, velocity_w: Float[Array, "3 N *B"]) -> Float[Array, "3 N *B"]:
    """Velocity estimate minus velocity [m/s]; its integral is the drift of the position estimate."""
    return sensor.bias + sensor.scale * velocity_w


def known_opponents(sensed: Sensed, velocity_error_w: Float[Array, "3 N *B"]) -> Opponents:
    """Opponents in sight, placed and moving relative to the drone; of others what they told by radio."""
    sensor, seen = sensed.sensor, sensed.seen
    message = _ago(sensed.past, sensor.radio_delay)
    message = message._replace(position_w=message.told_w)
    told = _flown_on(message, _opponents(message.airborne, 0) & sensor.radio, sensor.radio_delay * sensor.control_dt)
    return Opponents(
        jnp.where(seen.present, seen.position_w + sensed.error_w[:, None], told.position_w),
        jnp.where(seen.present, seen.velocity_w + velocity_error_w[:, None], told.velocity_w),
        seen.present | told.present,
    )


def _flown_on(look: Look, present: Bool[Array, "K N *B"], age: Float[Array, "*B"] | float) -> Opponents:
    """All opponents of a look, flying on straight for `age` [s]."""
    velocity = _opponents(look.velocity_w, 1)
    return Opponents(_opponents(look.position_w, 1) + age * velocity, velocity, present)


def _opponents(values: Array, axis: int) -> Array:
    """As `all_opponents`, and none of a drone that flies alone."""
    if values.shape[axis] > 1:
        return all_opponents(values, axis)
    return jax.lax.slice_in_dim(jnp.expand_dims(values, axis), 0, 0, axis=axis)


def _look(sensed: Sensed, state: "RaceState", gates: Gates, rotation: Float[Array, "3 3 N *B"]) -> Look:
    position = state.drones.position_w
    axes = camera_axes(rotation, sensed.sensor.tilt)
    to_gates = _for_each_drone(gates.position_w, position.ndim + 1) - position[:, None]
    to_opponents = _opponents(position, 1) - position[:, None]
    return Look(
        gates=in_sight(sensed.sensor, axes, to_gates),
        solids={
            kind: in_sight(sensed.sensor, axes, _to_axes(gates.solids[kind], position))
            for kind in sensed.past.solids
            if gates.solids is not None
        },
        opponents=in_sight(sensed.sensor, axes, to_opponents),
        position_w=position,
        velocity_w=state.drones.velocity_w,
        airborne=state.airborne,
        error_w=sensed.error_w,
        told_w=position + sensed.error_w,
    )


def _to_axes(table: Float[Array, "C S *B"], position_w: Float[Array, "3 N *B"]) -> Float[Array, "3 S N *B"]:
    """From each drone to the axis of each solid, at its own height [m]."""
    level = _for_each_drone(table[:2], position_w.ndim + 1) - position_w[:2, None]
    return jnp.concatenate([level, jnp.zeros_like(level[:1])])


def camera_axes(
    rotation: Float[Array, "3 3 N *B"], tilt: Float[Array, "2 *B"]
) -> tuple[Float[Array, "3 N *B"], Float[Array, "3 N *B"], Float[Array, "3 N *B"]]:
    """Optical axis, left and up of a camera that is turned upwards by `tilt` [cosine, sine], in the world."""
    forward, left, up = rotation[:, 0], rotation[:, 1], rotation[:, 2]
    cosine, sine = tilt
    return cosine * forward + sine * up, left, cosine * up - sine * forward


def in_sight(
    sensor: Sensor, axes: tuple[Array, Array, Array], offset_w: Float[Array, "3 K N *B"]
) -> Bool[Array, "K N *B"]:
    """Whether points that are `offset_w` [m] away are within range and, for a camera, within its field of view."""
    ahead, left, up = (fold(operator.add, axis[:, None] * offset_w) for axis in axes)
    wide, high = sensor.half_view
    in_view = (ahead > 0) & (jnp.abs(left) <= wide * ahead) & (jnp.abs(up) <= high * ahead)
    return (norm(offset_w) <= sensor.reach) & (in_view | sensor.all_round)


def _for_each_drone(table: Float[Array, "C G *B"], ndim: int) -> Array:
    """Places of gates with an axis for the drones after that of the gates, up to `ndim` axes."""
    races = table.shape[2:]
    return table.reshape(*table.shape[:2], *(1,) * (ndim - 2 - len(races)), *races)


def _ago(past: Look, steps: Int[Array, "*B"]) -> Look:
    """The look of so many steps ago."""

    def chosen(of_steps: Array) -> Array:
        picked = of_steps[0]
        for back in range(1, of_steps.shape[0]):
            picked = jnp.where(steps >= back, of_steps[back], picked)
        return picked

    return jax.tree.map(chosen, past)


def _white(sensor: Sensor, step: Int[Array, "*B"], shape: tuple[int, ...]) -> Float[Array, "3 N *B"]:
    """Standard normal numbers that depend on the race's key and the step alone."""
    keys = jax.random.wrap_key_data(sensor.key.reshape(2, -1).T)

    def at(key: Array, step: Array) -> Array:
        return jax.random.normal(jax.random.fold_in(key, step), shape[:2])

    white = jax.vmap(at, out_axes=-1)(keys, step.reshape(-1))
    return white.reshape(*shape[:2], *step.shape)
