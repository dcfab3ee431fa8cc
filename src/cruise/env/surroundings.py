"""What a race may have of its own: where its gates stand, its air, and what its drones believe of themselves."""

import functools
import math
import operator
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, UInt32

from cruise.dynamics import DroneState, quaternion
from cruise.dynamics.parameters import AS_BUILT, Parameters
from cruise.dynamics.types import FreeBody
from cruise.env.sensing import Gates, Sensed, known_opponents, velocity_error
from cruise.vector import sin_cos

if TYPE_CHECKING:
    from cruise.env.types import RaceState

# Gusts are waves of these periods, spread evenly over the logarithm of what moves a small drone and what it can feel.
# No multiples of all of them meet within a race: of all such tables, this one repeats itself least in a minute.
GUST_PERIODS = (4.7, 2.43, 1.26, 0.65)  # [s]
GUST_LENGTH = 1.0  # correlation time of the turbulence [s]
MEASURED = 12  # position, velocity, attitude, body rates: three numbers each


class MovedGates(NamedTuple):
    """Where the gates of each race stand; as every drone believes, with an axis N after G."""

    position_w: Float[Array, "3 G *B"]  # [m]
    normal_w: Float[Array, "2 G *B"]
    half_size: Float[Array, "2 G *B"] | None = None  # None: as on the track
    tilt: Float[Array, "4 G *B"] | None = None  # as `Course.tilt`; None: as on the track
    solids: dict[str, Float[Array, "C S *B"]] | None = None  # as `Course.solids`; None: as on the track


class Gusts(NamedTuple):
    """Air that moves to and fro, alike for all drones of a race."""

    speed: Float[Array, "*B"]  # root mean square along every axis [m/s]
    phase: Float[Array, "3 W *B"]  # of every wave along every axis [rad]


class SensorErrors(NamedTuple):
    """What measured position [m], velocity [m/s], attitude [rad] and body rates [rad/s] are wrong by."""

    bias: Float[Array, "12 N *B"]  # for the whole race
    noise: Float[Array, "12 N *B"]  # standard deviation of what is new at every step
    key: UInt32[Array, "2 *B"]  # of that noise


class Surroundings(NamedTuple):
    """None: as the track says, in still air, measured exactly, at no cost."""

    gates: MovedGates | None = None
    gusts: Gusts | None = None
    errors: SensorErrors | None = None
    sensed: Sensed | None = None
    rest: Gates | None = None  # where gates that move are at rest: `gates` is where they stand now


class Conditions(NamedTuple):
    """What is drawn for a race that begins."""

    parameters: Parameters = AS_BUILT
    surroundings: Surroundings = Surroundings()


AS_SAID = Conditions()  # by vehicle and track


def gust_w(gusts: Gusts, time: Float[Array, "*B"]) -> Float[Array, "3 *B"]:
    """Velocity of the air [m/s] at `time` [s] since the start.

    A sum of waves with random phases (Shinozuka and Deodatis 1991) whose energies are those of Dryden's spectrum along
    the wind, 1 / (1 + (omega T)^2), times the frequency, for periods that are equally far apart in its logarithm.
    """
    waves = [
        amplitude * sin_cos(2 * math.pi / period * time + gusts.phase[:, wave])[0]
        for wave, (period, amplitude) in enumerate(zip(GUST_PERIODS, _amplitudes(), strict=True))
    ]
    return gusts.speed * functools.reduce(operator.add, waves)


def _amplitudes() -> list[float]:
    """Of the waves; the root mean square of their sum is 1."""
    frequencies = [2 * math.pi / period for period in GUST_PERIODS]
    energies = [omega / (1 + (omega * GUST_LENGTH) ** 2) for omega in frequencies]
    return [math.sqrt(2 * energy / sum(energies)) for energy in energies]


def is_exact(state: "RaceState") -> bool:
    """Whether drones measure the race as it is."""
    return state.surroundings.errors is None and state.surroundings.sensed is None


def perceive(state: "RaceState") -> "RaceState":
    """The race as its drones know it: what pilots see in place of the truth."""
    state = _known(state)
    errors = state.surroundings.errors
    if errors is None:
        return state
    wrong = errors.bias + errors.noise * _white(errors, state.step)
    return state._replace(drones=_mistaken(state.drones, *(wrong[i : i + 3] for i in range(0, MEASURED, 3))))


def _known(state: "RaceState") -> "RaceState":
    """By sightings, and by what is left of them."""
    sensed = state.surroundings.sensed
    if sensed is None:
        return state
    body = state.drones.body
    wrong = velocity_error(sensed.sensor, body.velocity_w)
    body = body._replace(position_w=body.position_w + sensed.error_w, velocity_w=body.velocity_w + wrong)
    surroundings = state.surroundings
    if sensed.gates is not None and surroundings.gates is not None:
        believed = {name: table for name, table in sensed.gates._asdict().items() if table is not None}
        surroundings = surroundings._replace(gates=surroundings.gates._replace(**believed))
    opponents = known_opponents(sensed, wrong) if state.airborne.shape[0] > 1 else None
    return state._replace(drones=state.drones._replace(body=body), surroundings=surroundings, opponents=opponents)


def as_known_by(state: "RaceState", drones: tuple[int, ...]) -> "RaceState":
    """A race as some drones perceive it who tell each other where they are: the others where the first believes them.

    Who it knows nothing of is out.
    """
    known, total = state.opponents, state.airborne.shape[0]
    others = np.array([drone for drone in range(total) if drone not in drones], int)
    if known is None or not others.size:
        return state._replace(opponents=None)
    place, body = (others - drones[0]) % total - 1, state.drones.body
    body = body._replace(
        position_w=body.position_w.at[:, others].set(known.position_w[:, place, drones[0]]),
        velocity_w=body.velocity_w.at[:, others].set(known.velocity_w[:, place, drones[0]]),
    )
    out = state.out.at[others].set(~known.present[place, drones[0]])
    return state._replace(drones=state.drones._replace(body=body), out=out, opponents=None)


def _white(errors: SensorErrors, step: Array) -> Float[Array, "12 N *B"]:
    """Standard normal numbers that depend on the race's key and the step alone."""
    races = step.shape
    keys = jax.random.wrap_key_data(errors.key.reshape(2, -1).T)
    shape = errors.bias.shape[:2]

    def at(key: Array, step: Array) -> Array:
        return jax.random.normal(jax.random.fold_in(key, step), shape)

    white = jax.vmap(at, out_axes=-1)(keys, step.reshape(-1))
    return white.reshape(*shape, *races)


def _mistaken(drones: DroneState, position: Array, velocity: Array, turn: Array, rates: Array) -> DroneState:
    """Drones that are farther on, faster and turned about their own axes [rad] by so much."""
    body = drones.body
    moved = {
        "position_w": body.position_w + position,
        "velocity_w": body.velocity_w + velocity,
        "angular_velocity_b": body.angular_velocity_b + rates,
    }
    if isinstance(body, FreeBody):
        moved["attitude"] = quaternion.turned(body.attitude, turn)
    else:
        moved["euler"] = body.euler + turn
    return drones._replace(body=body._replace(**moved))
