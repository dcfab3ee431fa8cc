"""Policies with random parameters, for tests that need one on disk or in a race."""

from pathlib import Path

import jax

from cruise.config import TrainConfig
from cruise.env.race_env import make_race_env
from cruise.pilots.network import ActorCritic
from cruise.presets import TRACKS, VEHICLES
from cruise.storage.policy_file import PolicyMeta, save_policy


def observation_size(track="ring", drones=2, observation="extended"):
    env = make_race_env(TRACKS[track], drones, VEHICLES["paper"], observation)
    return jax.eval_shape(env.observe, jax.eval_shape(env.reset, jax.random.key(0))).shape[0]


def random_params(track="ring", drones=2, observation="extended", hidden=(8, 8), seed=0):
    return ActorCritic(observation_size(track, drones, observation), 3, hidden, -0.5, jax.random.key(seed))


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
