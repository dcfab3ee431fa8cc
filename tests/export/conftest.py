"""Policies of each kind, with races recorded once."""

import numpy as np
import pytest

from cruise.export.files import Exporter
from cruise.presets import TRACKS
from cruise.storage.policy_file import Policy, read_policy
from tests.pilots.test_neural import loud_params
from tests.storage.policies import meta

KINDS = {
    "shipped": ("ring", 4, "extended"),
    "agile": ("ring", 8, "body"),
    "agile-near": ("figure-eight", 8, "body-near"),
    "agile-alone": ("figure-eight", 1, "body"),
    "alone": ("figure-eight", 1, "extended"),
    "paper": ("figure-eight", 3, "paper"),
}
SHIPPED = {
    "shipped": "ring-4",
    "agile": "racer-ring",
    "agile-near": "racer-figure-eight-field",
    "agile-alone": "racer-random",
}
AGILE = ("agile", "agile-near", "agile-alone")


def policy_of(kind):
    track, drones, observation = KINDS[kind]
    if kind in SHIPPED:
        return read_policy(SHIPPED[kind])
    params = loud_params(track=track, drones=drones, observation=observation)
    return Policy(meta(track, drones, observation, name=f"{kind} */ policy"), params)


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
            made[kind] = Exporter.of(policy_of(kind), TRACKS[KINDS[kind][0]])
        return made[kind]

    return exporter
