"""Policies with random parameters, for tests that need one on disk or in a race."""

import functools
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import TrainConfig
from cruise.env.race_env import make_race_env
from cruise.pilots.network import ActorCritic, NetworkShape
from cruise.presets import VEHICLES
from cruise.racing.track_file import load_track
from cruise.storage.policy_file import PolicyMeta, save_policy


@functools.cache
def observation_size(track="ring", drones=2, observation="extended"):
    env = make_race_env(load_track(track), drones, VEHICLES["paper"], observation)
    return jax.eval_shape(env.observe, jax.eval_shape(env.reset, jax.random.key(0))).shape[0]


def random_params(track="ring", drones=2, observation="extended", seed=0, actions=3, hidden=(8, 8), **kind):
    """Networks of small layers for what is seen in a race of the paper's vehicle."""
    size = observation_size(track, drones, observation)
    return random_network(NetworkShape(size, actions, hidden, **kind), seed)


def random_network(shape, seed=0):
    """Drawn by NumPy, because JAX would compile for each shape."""
    shapes = eqx.filter_eval_shape(ActorCritic, shape, 0.0, jax.random.key(0))
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda leaf: jnp.array(rng.normal(size=leaf.shape, scale=0.4), jnp.float32), shapes)


def meta(track="ring", drones=2, observation="extended", **changes):
    fields = {
        "name": "test",
        "track": track,
        "drones": drones,
        "vehicle": "paper",
        "observation": observation,
        "agility": 7.5,
        "steps": 1000,
        "seed": 3,
        "version": "0.1.0",
        "config": TrainConfig(drones=drones),
    }
    return PolicyMeta(**fields | changes)


def write_policy(path: Path, track="ring", drones=2, **changes) -> Path:
    """A policy of random parameters at `path`."""
    return save_policy(path, random_params(track, drones), meta(track, drones, **changes))
