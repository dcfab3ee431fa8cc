"""Small things that tests of several folders share."""

import contextlib

import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import Gate, Track
from cruise.env.observation import OBSERVATIONS
from cruise.env.payment import REWARD_TERMS
from cruise.pilots import terms_file


def leaves(tree: object) -> list[np.ndarray]:
    """Arrays of a pytree."""
    return [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]


def assert_trees_close(actual: object, expected: object, atol: float = 0.0, rtol: float = 0.0) -> None:
    """Same structure, same shapes, every leaf within the tolerance."""
    assert jax.tree.structure(actual) == jax.tree.structure(expected)
    for a, b in zip(leaves(actual), leaves(expected), strict=True):
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, atol=atol, rtol=rtol)


def arrays(tree: object) -> object:
    """The pytree with Python numbers as arrays, as a compiled function would see it."""
    return jax.tree.map(jnp.asarray, tree)


def yaw_matrix(yaw: float) -> np.ndarray:
    """Rotation about the world's z axis."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def random_track(seed: int, gates: int = 7) -> Track:
    """Gates of random height, yaw and size on a wobbly loop, in generous bounds."""
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(gates) + rng.uniform(-0.3, 0.3, gates)) / gates
    radii = rng.uniform(8.0, 16.0, gates)
    placed = tuple(
        Gate(
            (float(r * np.cos(a)), float(r * np.sin(a)), float(rng.uniform(1.0, 8.0))),
            yaw=float(a + np.pi / 2 + rng.uniform(-0.6, 0.6)),
            width=float(rng.uniform(1.5, 3.0)),
            height=float(rng.uniform(1.5, 3.0)),
        )
        for r, a in zip(radii, angles, strict=True)
    )
    return Track("random", placed, bounds_low=(-30.0, -30.0, 0.0), bounds_high=(30.0, 30.0, 20.0))


def flat(data: dict, path: str = "") -> dict:
    """Nested dictionaries as one, keys joined by dots."""
    found = {}
    for key, value in data.items():
        found |= flat(value, f"{path}{key}.") if isinstance(value, dict) else {path + key: value}
    return found


@contextlib.contextmanager
def terms_forgotten():
    """Observations and terms that are made known within are forgotten after it."""
    known = [dict(OBSERVATIONS), dict(REWARD_TERMS), list(terms_file.LOADED)]
    yield
    for now, before in zip((OBSERVATIONS, REWARD_TERMS), known, strict=False):
        now.clear()
        now.update(before)
    terms_file.LOADED[:] = known[2]
