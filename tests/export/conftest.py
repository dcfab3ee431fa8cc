"""Policies of each kind, with races recorded once."""

import dataclasses

import jax
import numpy as np
import pytest

from cruise.env.race_env import make_race_env
from cruise.export.files import Exporter
from cruise.pilots.network import NetworkShape
from cruise.presets import TRACKS, VEHICLES
from cruise.storage.policy_file import Policy, read_policy
from tests.pilots.test_neural import loud_params
from tests.storage.policies import meta, random_network, random_params

KINDS = {
    "shipped": ("ring", 4, "extended"),
    "agile": ("ring", 8, "body"),
    "agile-near": ("figure-eight", 8, "body-near"),
    "agile-alone": ("figure-eight", 1, "body"),
    "alone": ("figure-eight", 1, "extended"),
    "paper": ("figure-eight", 3, "paper"),
    "memory": ("ring", 2, "extended"),
    "told": ("leaning", 2, "body"),
}
TOLD = dataclasses.replace(VEHICLES["racer"], control="velocity")
ATOL = {"action": 1e-5, "memory": 1e-5, "tracking": 1e-4}  # gains make the last of the first
GRU = {"kind": "gru", "memory_size": 20}
SHIPPED = {
    "shipped": "ring-4",
    "agile": "racer-ring",
    "agile-near": "racer-figure-eight-field",
    "agile-alone": "generalist",
}
AGILE = ("agile", "agile-near", "agile-alone")


def leaning(track):
    """Every gate rolled and pitched in its own way."""
    gates = (dataclasses.replace(g, roll=0.4 - 0.2 * i, pitch=0.3 * (-1) ** i) for i, g in enumerate(track.gates))
    return dataclasses.replace(track, name="leaning", gates=tuple(gates))


def track_of(kind):
    return leaning(TRACKS["ring"]) if kind == "told" else TRACKS[KINDS[kind][0]]


def policy_of(kind):
    track, drones, observation = KINDS[kind]
    if kind in SHIPPED:
        return read_policy(SHIPPED[kind])
    name = f"{kind} */ policy"
    if kind == "told":
        shape = NetworkShape(seen_by(track_of(kind), drones, TOLD, observation), TOLD.action.size, (8, 8), **GRU)
        about = {"name": name, "vehicle": TOLD, "agility": TOLD.agility}
        return Policy(meta(track, drones, observation, **about), random_network(shape))
    if kind == "memory":
        params = random_params(track, drones, observation, **GRU)
    else:
        params = loud_params(track=track, drones=drones, observation=observation)
    return Policy(meta(track, drones, observation, name=name), params)


def seen_by(track, drones, vehicle, observation):
    """How many numbers."""
    env = make_race_env(track, drones, vehicle, observation)
    return jax.eval_shape(env.observe, jax.eval_shape(env.reset, jax.random.key(0))).shape[0]


def lost_others(recording):
    """The same, but nobody knows where those are that left the air."""
    gone = ~recording.inputs["others_airborne"]
    assert gone.any()
    lost = {}
    for name in ("others_position_w", "others_velocity_w"):
        lost[name] = recording.inputs[name].copy()
        lost[name][gone] = np.nan
    return recording._replace(inputs=recording.inputs | lost)


@pytest.fixture(scope="session")
def exporters():
    """An exporter of each kind, made when it is asked for."""
    made = {}

    def exporter(kind):
        if kind not in made:
            made[kind] = Exporter.of(policy_of(kind), track_of(kind))
        return made[kind]

    return exporter
