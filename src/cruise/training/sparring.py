"""Sparring partners: opponents flown by hand, for who meets none but copies of itself beats nobody else."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.pilots.scripted import Chaser
from cruise.training.types import ACTIVE, Sparring

SLOWEST = 0.1  # of the speed that the vehicle's velocity loop is meant for


def draw_sparring(key: Array, env: RaceEnv, num_races: int, share: float) -> Sparring:
    """Each opponent of each race is a partner with probability `share`; of every speed, and half of them are blind."""
    where, how_fast, looks = jax.random.split(key, 3)
    shape = (env.num_drones, num_races)
    fastest = env.vehicle.tracking.speed
    opponents = jnp.arange(env.num_drones)[:, None] != ACTIVE
    partners = opponents & (jax.random.uniform(where, shape) < share)
    speed = jax.random.uniform(how_fast, shape, minval=SLOWEST * fastest, maxval=fastest)
    push = Chaser().push * jax.random.bernoulli(looks, shape=shape).astype(speed.dtype)
    return Sparring(jnp.where(partners, speed, 0.0), push)


def fly_sparring(
    env: RaceEnv, races: RaceState, flown: Float[Array, "A N E"], sparring: Sparring, agility: Array | float
) -> Float[Array, "A N E"]:
    """The actions `flown`, those of sparring partners in their place."""
    chaser = Chaser().for_vehicle(env.vehicle)
    action = chaser.command(env, races, sparring.speed, sparring.push, agility)
    return jnp.where(sparring.speed > 0, action, flown)
