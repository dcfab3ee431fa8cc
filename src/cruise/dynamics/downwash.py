"""The air that rotors push down, and where it blows: what the other drones in the air are to a drone."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.config import Rotors
from cruise.dynamics.battery import AIR_DENSITY
from cruise.vector import dot

SPREAD = 0.094  # half-width of a round turbulent jet per distance (Hussein, Capp and George, JFM 1994)
SHARPNESS = (2**0.5 - 1) / SPREAD**2  # a of the jet's profile


def core_length(rotors: Rotors) -> float:
    """Where the jet of all four rotors has become one that keeps its shape; nearer, it is as wide as there [m].

    There the speed on its axis is that of the contracted wake of momentum theory, sqrt(2 T / rho A): no air is faster.
    """
    disc = 4 * jnp.pi * rotors.radius**2
    return float((3 * SHARPNESS * disc / (2 * jnp.pi)) ** 0.5)


def jet_speed(
    thrust: Float[Array, "*B"], along: Float[Array, "*B"], across2: Float[Array, "*B"], core: float
) -> Float[Array, "*B"]:
    """Speed of the air [m/s] in the jet of a drone, `along` [m] down its axis and the root of `across2` [m^2] off it.

    U = U_c / (1 + a (r / s)^2)^2 with U_c = sqrt(3 a T / (pi rho)) / s: the self-similar round jet (Pope, Turbulent
    Flows, Sec. 5.1), whose momentum flux is the thrust at every distance. That the flow below a quadrotor is such a jet
    was measured by Bauersfeld et al. (Robotics meets Fluid Dynamics, RA-L 2025). Above the drone there is none.
    """
    reach = jnp.maximum(along, core)
    centre = jnp.sqrt(3 * SHARPNESS / (jnp.pi * AIR_DENSITY) * jnp.maximum(thrust, 0.0)) / reach
    profile = 1 + SHARPNESS * across2 / (reach * reach)
    return jnp.where(along > 0, centre / (profile * profile), 0.0)


def induced_air_w(
    rotors: Rotors,
    position_w: Float[Array, "3 N *B"],
    axis_w: Float[Array, "3 N *B"],
    thrust: Float[Array, "N *B"],
    airborne: Bool[Array, "N *B"],
) -> Float[Array, "3 N *B"]:
    """Velocity of the air at each drone that the jets of all the others make there, added up [m/s].

    A jet blows along minus the thrust axis, as if the drone that makes it stood still. A fast one leaves its jet
    behind, so that this is the most that it can do to the others.
    """
    air = jnp.zeros_like(position_w)
    core = core_length(rotors)
    for k in range(1, airborne.shape[0]):
        axis, push = jnp.roll(axis_w, -k, 1), jnp.roll(jnp.where(airborne, thrust, 0.0), -k, 0)
        offset = position_w - jnp.roll(position_w, -k, 1)
        along = -dot(offset, axis)
        across2 = jnp.maximum(dot(offset, offset) - along * along, 0.0)
        air -= jet_speed(push, along, across2, core) * axis
    return air
