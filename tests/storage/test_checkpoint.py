"""Checkpoints: bit for bit, whole, and the one before as a fallback."""

import json
import os
import pickle
import shutil

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from cruise.errors import CruiseError
from cruise.storage import checkpoint as module
from cruise.storage import tensors
from cruise.storage.checkpoint import CURRENT, PREVIOUS, load_checkpoint, load_meta, save_checkpoint
from tests.storage.policies import random_params

META = {"steps": 7, "config": {"track": "ring"}, "seconds": 1.5}


def state():
    """Everything that a training state holds, and some awkward arrays."""
    params = random_params()
    return {
        "key": jax.random.key(3),
        "keys": jax.random.split(jax.random.key(4), 5),
        "flags": jnp.array([True, False]),
        "count": jnp.int32(-4),
        "bits": jnp.array([0, 2**32 - 1], jnp.uint32),
        "params": params,
        "optimiser": optax.adam(1e-3).init(params),
        "odd": jnp.array([jnp.nan, -0.0, jnp.inf, 1e-45], jnp.float32),
        "double": np.array([1 / 3, 1e300]),
        "transposed": np.arange(6.0).reshape(2, 3).T,
        "empty": jnp.zeros((0, 3)),
        "nested": ((jnp.ones(2),), [jnp.zeros(())]),
    }


def bits(leaf):
    is_key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    data = np.asarray(jax.random.key_data(leaf) if is_key else leaf)
    return str(leaf.dtype), data.shape, data.tobytes()


def test_bit_exact_round_trip(tmp_path):
    tree = state()
    save_checkpoint(tmp_path, tree, META)
    for like in (tree, jax.tree.map(lambda a: a if isinstance(a, np.ndarray) else jax.typeof(a), tree)):
        shapes = jax.tree.map(
            lambda a: a if isinstance(a, np.ndarray) else jax.ShapeDtypeStruct(a.shape, a.dtype), like
        )
        loaded, meta = load_checkpoint(tmp_path, shapes)
        assert meta == META
        assert jax.tree.structure(loaded) == jax.tree.structure(tree)
        for a, b in zip(jax.tree.leaves(tree), jax.tree.leaves(loaded), strict=True):
            assert bits(a) == bits(b)
    np.testing.assert_array_equal(jax.random.normal(loaded["key"], 3), jax.random.normal(tree["key"], 3))
    assert load_meta(tmp_path) == META
    assert os.listdir(tmp_path) == [CURRENT]


def test_the_one_before_is_kept_and_used(tmp_path, caplog):
    for step in range(3):
        save_checkpoint(tmp_path, {"x": jnp.full(1000, step)}, {"step": step})
    like = {"x": jnp.zeros(1000, jnp.int32)}
    assert load_checkpoint(tmp_path, like)[1] == {"step": 2}
    newest = (tmp_path / CURRENT).read_bytes()
    (tmp_path / CURRENT).write_bytes(newest[:-1])
    tree, meta = load_checkpoint(tmp_path, like)
    assert meta == {"step": 1}
    assert set(np.asarray(tree["x"])) == {1}
    assert "not a whole safetensors file" in caplog.text
    (tmp_path / CURRENT).unlink()
    assert load_meta(tmp_path) == {"step": 1}


@pytest.mark.parametrize("moment", [0, 1])
def test_death_between_the_renames_loses_at_most_one(moment, tmp_path, monkeypatch):
    """Whichever rename the process dies before, a whole checkpoint remains."""
    for step in range(2):
        save_checkpoint(tmp_path, {"x": jnp.array(step)}, {"step": step})
    renames = iter(range(10))
    replace = os.replace

    def die(source, target):
        if next(renames) == moment:
            raise KeyboardInterrupt
        replace(source, target)

    monkeypatch.setattr(module.os, "replace", die)
    monkeypatch.setattr(module, "write_atomically", lambda path, data: path.write_bytes(data))
    with pytest.raises(KeyboardInterrupt):
        save_checkpoint(tmp_path, {"x": jnp.array(2)}, {"step": 2})
    assert load_meta(tmp_path) == {"step": 1}


def test_only_plain_numbers_are_stored(tmp_path):
    with pytest.raises(TypeError, match="only booleans, integers and floats"):
        save_checkpoint(tmp_path, {"x": jnp.ones(2, jnp.bfloat16)}, {})
    assert os.listdir(tmp_path) == []


LIKE = {"x": jnp.zeros((2, 3)), "k": jax.random.key(0)}


def written(arrays, metadata=None):
    return tensors.encode(arrays, {"cruise": json.dumps(META)} if metadata is None else metadata)


X, K = np.zeros((2, 3), np.float32), np.zeros(2, np.uint32)
MALFORMED = {
    "cut short": (written({"['x']": X, "['k']": K})[:-1], "not a whole safetensors file"),
    "cut in the header": (written({"['x']": X, "['k']": K})[:30], "not a whole safetensors file"),
    "too long": (written({"['x']": X, "['k']": K}) + b"0", "not a whole safetensors file"),
    "empty": (b"", "not a whole safetensors file"),
    "pickle": (pickle.dumps({"x": X}), "not a whole safetensors file"),
    "missing array": (written({"['x']": X}), "lacks array \"['k']\""),
    "extra array": (written({"['x']": X, "['k']": K, "y": X}), "has unknown array 'y'"),
    "wrong shape": (written({"['x']": X.T, "['k']": K}), "array \"['x']\" is float32 [3, 2], expected float32 [2, 3]"),
    "wrong type": (written({"['x']": X.astype(int), "['k']": K}), "array \"['x']\" is int64 [2, 3], expected float32"),
    "no key data": (written({"['x']": X, "['k']": K[:1]}), "array \"['k']\" is uint32 [1], expected uint32 [2]"),
    "not ours": (written({"['x']": X, "['k']": K}, {}), "has no 'cruise' metadata"),
    "bad metadata": (written({"['x']": X, "['k']": K}, {"cruise": "{"}), "not valid JSON"),
    "metadata of another kind": (written({"['x']": X, "['k']": K}, {"cruise": "[]"}), "metadata is not a JSON object"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed(case, tmp_path):
    content, message = MALFORMED[case]
    (tmp_path / CURRENT).write_bytes(content)
    with pytest.raises(CruiseError) as error:
        load_checkpoint(tmp_path, LIKE)
    assert str(error.value).startswith(f"checkpoint {tmp_path / CURRENT}: {message}")
    assert "\n" not in str(error.value)
    shutil.copy(tmp_path / CURRENT, tmp_path / PREVIOUS)
    with pytest.raises(CruiseError, match=CURRENT):
        load_checkpoint(tmp_path, LIKE)


def test_nothing_to_load(tmp_path):
    for folder in (tmp_path, tmp_path / "none"):
        with pytest.raises(CruiseError, match=r"^no checkpoint in .*: expected checkpoint.safetensors$"):
            load_checkpoint(folder, LIKE)
