"""What the user computes in double precision is his; races and stored policies stay in single."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np

import cruise
from cruise import api_training
from cruise.config import TrainConfig
from cruise.storage import tensors
from cruise.storage.policy_file import read_policy, save_policy
from tests.storage.policies import meta, random_params

COMMAND = """
from cruise.cli.compilation import prepare_flight
prepare_flight()
import jax.numpy as jnp
print(jnp.ones(1).dtype)
"""


def test_policies_are_stored_in_single_precision(tmp_path):
    with jax.enable_x64(True):
        double = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), random_params())
        path = save_policy(tmp_path / "a", double, meta())
        policy, shipped = read_policy(path), read_policy("ring-4")
    arrays, _ = tensors.load(path, "policy")
    leaves = [*arrays.values(), *jax.tree.leaves(policy.params), *jax.tree.leaves(shipped.params)]
    assert {leaf.dtype for leaf in leaves} == {np.dtype(np.float32)}
    assert jax.tree.leaves(read_policy(path).params)[0].dtype == np.float32


def test_races_are_the_same(monkeypatch):
    plain = cruise.race(drones=2, laps=1, seed=3)
    with jax.enable_x64(True):
        assert jnp.ones(1).dtype == np.float64
        double = cruise.race(drones=2, laps=1, seed=3)
        assert jnp.ones(1).dtype == np.float64
    np.testing.assert_array_equal(double.position_w, plain.position_w)
    assert double.position_w.dtype == plain.position_w.dtype


def test_training_is_in_single_precision(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(api_training, "Session", lambda *_: seen.append(jnp.ones(1).dtype) or 1 / 0)
    with jax.enable_x64(True):
        try:
            cruise.train(TrainConfig(), tmp_path / "run")
        except ZeroDivisionError:
            assert seen == [np.float32]


def test_commands_compute_in_single_precision():
    done = subprocess.run(
        [sys.executable, "-c", COMMAND],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"JAX_ENABLE_X64": "1"},
    )
    assert done.stdout == "float32\n"


def test_a_platform_that_is_not_there_is_told_in_one_line():
    for platform, words in (("cuda", "there is no such device"), ("abacus", "Unable to initialize backend 'abacus'")):
        command = [sys.executable, "-m", "cruise", "race"]
        environment = os.environ | {"JAX_PLATFORMS": platform}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 2
        assert done.stderr.startswith(f"error: JAX cannot use JAX_PLATFORMS={platform}: {words}")
        assert done.stderr.count("\n") == 1
