"""The random keys of a run: one split of the seed, so that no stream meets another.

JAX gives `fold_in(key, i)` the very numbers of `split(key)[i]`: whoever does both with one key draws the same twice.
"""

import jax
import numpy as np
from jaxtyping import Array, UInt32

STREAMS = 6  # model, races, ages, updates, sparring partners, evaluations


def run_keys(seed_key: Array) -> Array:
    """Keys of a run's beginning: model, races, ages of the episodes, updates, sparring partners."""
    return jax.random.split(seed_key, STREAMS)[:-1]


def evaluation_keys(origin: UInt32[Array, "2"] | np.ndarray) -> Array:
    """Keys of an evaluation, for its races and for the league; `origin`: the seed and the number of the update."""
    seed, update = origin
    evaluations = jax.random.split(jax.random.key(seed), STREAMS)[-1]
    return jax.random.split(jax.random.fold_in(evaluations, update))
