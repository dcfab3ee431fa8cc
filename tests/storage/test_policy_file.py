"""Policies on disk: the same numbers back, names found, and everything else refused in one line."""

import dataclasses
import json
import os
import pickle

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Randomisation, TrainConfig
from cruise.errors import CruiseError
from cruise.presets import RANDOMISATION, TRACKS
from cruise.racing.track_file import ANY
from cruise.storage import policy_paths, tensors
from cruise.storage.config_file import to_data
from cruise.storage.policy_file import list_policies, load_policy, read_meta, read_policy, save_policy, shipped_name
from tests.storage.policies import meta, random_params, write_policy


def test_round_trip(tmp_path):
    params, about = random_params(), meta(results={"success_rate": {"mean": 1.0, "low": None}})
    path = save_policy(tmp_path / "v1.2", params, about)
    assert sorted(os.listdir(tmp_path)) == ["v1.2.json", "v1.2.safetensors"]
    policy = read_policy(path)
    assert eqx.tree_equal(policy.params, params)
    assert policy.meta == dataclasses.replace(about, config=to_data(TrainConfig(drones=2)))
    pilot = policy.pilot()
    assert (pilot.name, pilot.drones, pilot.agility, pilot.observation) == ("test", 2, 7.5, "extended")


def test_every_way_to_name_it(tmp_path, monkeypatch):
    path = write_policy(tmp_path / "policy.safetensors")
    monkeypatch.chdir(tmp_path)
    for name in (path, str(path), path.with_suffix(".json"), path.with_suffix(""), tmp_path, "policy", "."):
        assert load_policy(name).name == "test"


def test_shipped_ones_are_found_by_name(tmp_path, monkeypatch):
    monkeypatch.setattr(policy_paths, "SHIPPED", tmp_path)
    write_policy(tmp_path / "ring-2", name="run/policy")
    write_policy(tmp_path / "figure-eight-2", track="figure-eight")
    assert list(list_policies()) == ["figure-eight-2", "ring-2"]
    assert shipped_name("ring", 2) == "ring-2"
    assert load_policy("ring-2").name == "ring-2"
    assert read_meta("ring-2").drones == 2
    with pytest.raises(
        CruiseError, match=r"no policy is shipped .*'ring' with 5 drones; shipped: figure-eight-2, ring-2"
    ):
        shipped_name("ring", 5)
    with pytest.raises(CruiseError, match="did you mean 'ring-2'"):
        load_policy("ring2")
    with pytest.raises(CruiseError, match="'ring' with 2 drones and vehicle 'racer'; shipped"):
        shipped_name("ring", 2, "racer")
    write_policy(tmp_path / "racer-ring", vehicle="racer")
    assert shipped_name("ring", 2, "racer") == shipped_name("ring", 7, "racer") == "racer-ring"
    write_policy(tmp_path / "generalist", vehicle="racer", track="any")
    assert shipped_name("ring", 2, "racer") == "racer-ring"
    assert shipped_name("split-s", 1, "racer") == shipped_name("my track", 1, "racer") == "generalist"
    with pytest.raises(CruiseError, match="'split-s' with 2 drones and vehicle 'racer'; shipped"):
        shipped_name("split-s", 2, "racer")
    write_policy(tmp_path / "racer-split-s", vehicle="racer", track="split-s", drones=1)
    assert shipped_name("split-s", 1, "racer") == "racer-split-s"
    with pytest.raises(CruiseError, match="'split-s' with 2 drones and vehicle 'racer'; shipped"):
        shipped_name("split-s", 2, "racer")
    write_policy(tmp_path / "racer-split-s-field", vehicle="racer", track="split-s", drones=8)
    assert shipped_name("split-s", 2, "racer") == shipped_name("split-s", 8, "racer") == "racer-split-s-field"
    assert shipped_name("split-s", 1, "racer") == "racer-split-s"


def test_what_is_shipped_is_sound():
    """Each policy in pairs of files, named after track, vehicle and drones, measured, and loadable.

    Sturdy ones fly where they are asked for by name; they are random by all that is full.
    """
    files = {path.name for path in policy_paths.SHIPPED.glob("*")} - {"__init__.py", "__pycache__"}
    policies = list_policies()
    assert files == {name + ending for name in policies for ending in (".json", ".safetensors")}
    for name, about in policies.items():
        assert name.removesuffix("-sturdy") == shipped_name(about.track, about.drones, about.vehicle)
        assert about.track in (*TRACKS, ANY)
        assert (about.results["track"], about.results["drones"]) == (about.track, about.drones)
        assert load_policy(name).name == name
        if name.endswith("-sturdy"):
            assert Randomisation(**about.config["randomisation"]) == RANDOMISATION[about.vehicle]


def edited(change):
    """Applies `change` to the description."""

    def corrupt(folder):
        data = json.loads((folder / "p.json").read_text())
        change(data)
        (folder / "p.json").write_text(json.dumps(data))

    return corrupt


def rewritten(change):
    """Applies `change` to the arrays."""

    def corrupt(folder):
        arrays, _ = tensors.load(folder / "p.safetensors", "policy")
        change(arrays)
        (folder / "p.safetensors").write_bytes(tensors.encode(arrays))

    return corrupt


def content(name, data):
    return lambda folder: (folder / name).write_bytes(data)


def shortened(folder):
    path = folder / "p.safetensors"
    path.write_bytes(path.read_bytes()[:-7])


def put(array, value):
    def change(arrays):
        arrays[array][0] = value

    return change


WEIGHT = "actor.layers[0].weight"
MALFORMED = {
    "no parameters": (lambda f: (f / "p.safetensors").unlink(), "does not exist"),
    "no description": (lambda f: (f / "p.json").unlink(), "does not exist"),
    "cut short": (shortened, "not a whole safetensors file"),
    "empty parameters": (content("p.safetensors", b""), "not a whole safetensors file"),
    "pickle": (content("p.safetensors", pickle.dumps({"w": 1})), "not a whole safetensors file"),
    "not JSON": (content("p.json", b"{"), "not valid JSON"),
    "JSON of another kind": (content("p.json", b"3"), "expected a JSON object, got 3"),
    "unknown key": (edited(lambda d: d.update(extra=1)), "unknown key 'extra'"),
    "missing key": (edited(lambda d: d["policy"].pop("drones")), "policy.drones: missing"),
    "wrong type": (edited(lambda d: d["policy"].update(drones="2")), "policy.drones: expected an integer, got '2'"),
    "unknown observation": (
        edited(lambda d: d["policy"].update(observation="x")),
        "sees by the observation 'x', which is not known here: give the file that declares it",
    ),
    "unknown vehicle": (edited(lambda d: d["policy"].update(vehicle="x")), "unknown vehicle 'x'; vehicles: "),
    "no drones": (edited(lambda d: d["policy"].update(drones=0)), "drones must be from 1 to"),
    "no agility": (edited(lambda d: d["policy"].update(agility=0.0)), "agility must be above 0"),
    "config of another kind": (edited(lambda d: d["policy"].update(config=[])), "policy.config: expected an object"),
    "future format": (edited(lambda d: d.update(format=9)), "format 9, this program reads 2"),
    "immense layer": (edited(lambda d: d["network"].update(hidden=[10**12])), "hidden[0] must be from 1 to"),
    "other layers": (edited(lambda d: d["network"].update(hidden=[8])), "has unknown array"),
    "more layers": (edited(lambda d: d["network"].update(hidden=[8, 8, 8])), "lacks array"),
    "other width": (edited(lambda d: d["network"].update(hidden=[9, 8])), f"array '{WEIGHT}' is float32 [8, "),
    "other observation": (edited(lambda d: d["network"].update(observation_size=5)), f"array '{WEIGHT}' is float32"),
    "array missing": (rewritten(lambda a: a.pop("log_std")), "lacks array 'log_std'"),
    "array too many": (rewritten(lambda a: a.update(x=np.zeros(1))), "has unknown array 'x'"),
    "array of another type": (
        rewritten(lambda a: a.update(log_std=np.zeros(3))),
        "array 'log_std' is float64 [3], expected float32 [3]",
    ),
    "NaN": (rewritten(put(WEIGHT, np.nan)), f"array '{WEIGHT}' holds numbers that are not finite"),
    "infinity": (rewritten(put("log_std", np.inf)), "array 'log_std' holds numbers that are not finite"),
    "another policy's parameters": (rewritten(put(WEIGHT, 0.25)), "checksum differs from that in p.json"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed(case, tmp_path):
    corrupt, message = MALFORMED[case]
    write_policy(tmp_path / "p")
    corrupt(tmp_path)
    with pytest.raises(CruiseError) as error:
        load_policy(tmp_path / "p")
    assert str(tmp_path / "p") in str(error.value)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["", "no-such", "no/such/file.safetensors", "nul\0byte", "/etc/passwd"])
def test_names_that_lead_nowhere(name):
    with pytest.raises(CruiseError) as error:
        load_policy(name)
    assert "\n" not in str(error.value)


@pytest.mark.filterwarnings("error")
def test_what_is_not_sound_is_not_written(tmp_path):
    """Numbers that are not finite as they are stored, of half the precision, or none; a description that is wrong."""
    params = random_params()
    broken = eqx.tree_at(lambda p: p.log_std, params, jnp.array([0.0, jnp.nan, 0.0]))
    immense = eqx.tree_at(lambda p: p.log_std, params, np.array([0.0, 1e300, 0.0]))
    whole = eqx.tree_at(lambda p: p.log_std, params, np.zeros(3, np.int32))
    for save in (
        lambda: save_policy(tmp_path / "p", broken, meta()),
        lambda: save_policy(tmp_path / "p", immense, meta()),
        lambda: save_policy(tmp_path / "p", whole, meta()),
        lambda: save_policy(tmp_path / "p", params, meta(agility=-1.0)),
        lambda: save_policy(tmp_path / "p", params, meta(vehicle="none")),
        lambda: save_policy(tmp_path / "p", jax.tree.map(lambda x: x.astype(jnp.float16), params), meta()),
    ):
        with pytest.raises(CruiseError):
            save()
    assert os.listdir(tmp_path) == []


def test_double_precision_is_rounded(tmp_path):
    """As a run under JAX_ENABLE_X64 gives it."""
    params = random_params()
    double = jax.tree.map(lambda x: np.asarray(x, np.float64) * (1 + 1e-12), params)
    assert eqx.tree_equal(read_policy(save_policy(tmp_path / "p", double, meta())).params, params)
