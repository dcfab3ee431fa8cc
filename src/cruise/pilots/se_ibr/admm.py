"""Best responses by the alternating direction method of multipliers (Boyd et al., 2011), thousands at once.

Speeds, accelerations, and one copy of the positions for the corridor and for each opponent are variables of their own,
tied to the positions p by G p + d. So every constraint acts on its own copy, where its proximal operator is closed
form, and the linear system is one constant K x K matrix: inverted once, shared by all axes, drones, races and rounds.

The iteration is written as Douglas and Rachford's, on t = copy + scaled multiplier:

    z = prox(t)
    p = argmin of the smooth part + 1/2 |G p + d - (2 z - t)|^2, weighted by the penalties
    t <- t + relaxation (G p + d - z)
"""

import functools
import math
import operator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cruise.pilots.se_ibr.options import Algorithm, Weights
from cruise.pilots.se_ibr.programme import Multipliers, Programme
from cruise.vector import dot

RELAXATION = 1.6
SPEED_PENALTY, ACCELERATION_PENALTY, POSITION_PENALTY = 0.8, 0.16, 1.0  # of the augmented Lagrangian


class Copies(NamedTuple):
    """The variables on which the constraints act."""

    speed: Array  # [3, K, Q]
    acceleration: Array  # [3, K, Q]
    corridor: Array  # [3, K, Q]
    collision: Array  # [3, M, K, Q]


PENALTIES = (SPEED_PENALTY, ACCELERATION_PENALTY, POSITION_PENALTY, POSITION_PENALTY)  # of the copies


def solve(
    programme: Programme, algorithm: Algorithm, start: tuple[Array, Multipliers]
) -> tuple[Float[Array, "3 K N *B"], Multipliers]:
    """Positions and multipliers of every best response after a fixed number of iterations from `start`."""
    shape, dt, weights = programme.reward.shape, algorithm.dt, algorithm.weights
    flat, positions, multipliers = _flatten(programme, *start)
    prox = functools.partial(_prox, flat, algorithm)
    offset = _offset(flat, dt)
    inverse = jnp.asarray(_inverse(shape[1], flat.reach.shape[0], dt, weights), jnp.float32)
    linear = flat.reward + weights.centre * flat.centre_w - weights.acceleration * _second_t(offset.acceleration, dt)

    def copies(p: Array) -> Copies:
        speed = _first(p, dt)
        return Copies(speed + offset.speed, _first(speed, dt) + offset.acceleration, p, p[:, None])

    def positions_of(t: Copies, z: Copies) -> Array:
        w = [2 * zi - ti for zi, ti in zip(z, t, strict=True)]
        pull = ACCELERATION_PENALTY * _first_t(w[1] - offset.acceleration, dt) + SPEED_PENALTY * (w[0] - offset.speed)
        opponents = [w[3][:, m] for m in range(w[3].shape[1])]
        pull = _first_t(pull, dt) + POSITION_PENALTY * functools.reduce(operator.add, opponents, w[2])
        return jnp.stack([inverse @ row for row in linear + pull])  # three products; one over all would be transposed

    def iterate(_: Array, t: Copies) -> Copies:
        z = prox(t)
        y = copies(positions_of(t, z))
        return Copies(*(ti + RELAXATION * (yi - zi) for ti, yi, zi in zip(t, y, z, strict=True)))

    t = Copies(*(y + u for y, u in zip(copies(positions), multipliers, strict=True)))
    t = jax.lax.fori_loop(0, algorithm.iterations, iterate, t)
    z = prox(t)
    solved = _multipliers(flat, t, z)
    return positions_of(t, z).reshape(shape), jax.tree.map(lambda a: a.reshape(*a.shape[:-1], *shape[2:]), solved)


@functools.lru_cache(maxsize=64)
def _inverse(steps: int, opponents: int, dt: float, weights: Weights) -> np.ndarray:
    """Of the matrix that every linear system of every iteration shares."""
    first = (np.eye(steps) - np.eye(steps, k=-1)) / dt
    second = first @ first
    matrix = (weights.centre + POSITION_PENALTY * (1 + opponents)) * np.eye(steps)
    matrix += SPEED_PENALTY * first.T @ first + (ACCELERATION_PENALTY + weights.acceleration) * second.T @ second
    return np.linalg.inv(matrix)


def _flatten(programme: Programme, positions: Array, multipliers: Multipliers) -> tuple[Programme, Array, Copies]:
    """Drones and races as one trailing axis Q, and multipliers scaled and turned into vectors."""
    drones = programme.reward.shape[2:]
    programme, positions, multipliers = jax.tree.map(
        lambda a: a.reshape(*a.shape[: a.ndim - len(drones)], math.prod(drones)),
        (programme, positions, multipliers),
    )
    sideways, upward = multipliers.corridor
    scaled = Copies(
        multipliers.speed,
        multipliers.acceleration,
        sideways * programme.left_w + upward * programme.up_w,
        multipliers.collision * programme.towards_w,
    )
    return programme, positions, Copies(*(u / penalty for u, penalty in zip(scaled, PENALTIES, strict=True)))


def _multipliers(programme: Programme, t: Copies, z: Copies) -> Multipliers:
    speed, acceleration, corridor, collision = (
        penalty * (ti - zi) for penalty, ti, zi in zip(PENALTIES, t, z, strict=True)
    )
    sides = jnp.stack([dot(corridor, programme.left_w), dot(corridor, programme.up_w)])
    towards = jnp.maximum(dot(collision, programme.towards_w), 0.0)
    return Multipliers(speed, acceleration, sides, towards)


def _offset(programme: Programme, dt: float) -> Copies:
    """Offset d of the copies G p + d: what the given position and velocity add to first speeds and accelerations."""
    zero = jnp.zeros_like(programme.reward)
    speed = zero.at[:, 0].set(-programme.position_w / dt)
    acceleration = _first(speed, dt).at[:, 0].add(-programme.velocity_w / dt)
    return Copies(speed, acceleration, zero, zero[:, None])


def _first(p: Array, dt: float) -> Array:
    """Differences in time, from zero before the first step."""
    return jnp.concatenate([p[:, :1], p[:, 1:] - p[:, :-1]], axis=1) / dt


def _first_t(v: Array, dt: float) -> Array:
    """The transpose of `_first`."""
    return jnp.concatenate([v[:, :-1] - v[:, 1:], v[:, -1:]], axis=1) / dt


def _second_t(a: Array, dt: float) -> Array:
    return _first_t(_first_t(a, dt), dt)


def _prox(programme: Programme, algorithm: Algorithm, t: Copies) -> Copies:
    """The nearest copies that keep their constraint, or break it where the penalty is the lesser evil."""
    limit = _ball if algorithm.limit == "ball" else _box
    return Copies(
        _ball(t.speed, programme.speed),
        limit(t.acceleration, programme.acceleration),
        _into_corridor(programme, algorithm.weights.corridor / POSITION_PENALTY, t.corridor),
        _apart(programme, algorithm.weights.collision / POSITION_PENALTY, t.collision),
    )


def _ball(x: Array, radius: Array) -> Array:
    return x * jnp.minimum(1.0, radius * jax.lax.rsqrt(jnp.maximum(dot(x, x), 1e-12)))


def _box(x: Array, half: Array) -> Array:
    return jnp.clip(x, -half, half)


def _into_corridor(programme: Programme, step: float, p: Array) -> Array:
    offset = p - programme.centre_w
    moved = p
    for axis, low, high in zip((programme.left_w, programme.up_w), programme.low, programme.high, strict=True):
        along = dot(offset, axis)
        moved = moved + (_hinge(along, high, step) - _hinge(-along, -low, step) - 2 * along) * axis
    return moved


def _apart(programme: Programme, step: float, p: Array) -> Array:
    along = dot(programme.towards_w, p)
    return p + (_hinge(along, programme.reach, step) - along) * programme.towards_w


def _hinge(x: Array, limit: Array, step: float) -> Array:
    """Proximal operator of `step` times the excess of x over the limit."""
    return jnp.minimum(x, jnp.maximum(limit, x - step))
