"""One best response as a convex programme, and what its solution holds.

Every drone i of a race maximises, over its positions p^1 .. p^K, which lie `dt` apart,

    reward^k . p^k  summed over k
    - hinge penalties for leaving the corridor and for coming too near to opponents
    - small quadratic terms that make the optimum unique,

subject to |p^k - p^(k-1)| <= speed dt and |p^k - 2 p^(k-1) + p^(k-2)| <= acceleration dt^2, where p^0 and the velocity
before it are given. The norm of the acceleration is Euclid's, or the largest component (`Algorithm.limit`). Penalties
are exact: where no constraint needs to be broken, none is.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class Programme(NamedTuple):
    """The best responses of all drones, independent of each other. K steps, M = N - 1 opponents."""

    position_w: Float[Array, "3 N *B"]  # p^0 [m]
    velocity_w: Float[Array, "3 N *B"]  # [m/s]
    reward: Float[Array, "3 K N *B"]  # gradient of what is gained, in metres of progress per metre
    centre_w: Float[Array, "3 K N *B"]  # origin of the corridor's frames [m]
    left_w: Float[Array, "3 K N *B"]
    up_w: Float[Array, "3 K N *B"]
    low: Float[Array, "2 K N *B"]  # of the corridor, to the left and up [m]
    high: Float[Array, "2 K N *B"]
    towards_w: Float[Array, "3 M K N *B"]  # unit vectors to the opponents
    reach: Float[Array, "M K N *B"]  # towards . p^k stays below this [m]
    speed: Float[Array, "K N *B"]  # [m/s]
    acceleration: Float[Array, "N *B"]  # [m/s^2]


class Multipliers(NamedTuple):
    """Of each constraint at the solution, in metres of progress per unit of its left-hand side."""

    speed: Float[Array, "3 K N *B"]
    acceleration: Float[Array, "3 K N *B"]
    corridor: Float[Array, "2 K N *B"]
    collision: Float[Array, "M K N *B"]  # never negative


def no_multipliers(num_drones: int, steps: int, batch: tuple[int, ...]) -> Multipliers:
    """All zero: where nothing is known yet."""
    opponents = num_drones - 1
    sizes = ((3, steps), (3, steps), (2, steps), (opponents, steps))
    return Multipliers(*(jnp.zeros((*size, num_drones, *batch)) for size in sizes))
