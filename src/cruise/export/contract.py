"""What goes into an exported policy and what comes out, and the environment that it is compared in."""

import dataclasses
from typing import Any

import jax

from cruise.config import Track
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.errors import CruiseError
from cruise.export.pilot_program import Model
from cruise.racing.motion import must_stand_still
from cruise.storage.onnx_file import FORMAT_VERSION, Contract, ExportedGate, Interface, ObservationEntry
from cruise.storage.policy_file import Policy
from cruise.vehicles import find_vehicle


def export_env(policy: Policy, track: Track) -> RaceEnv:
    """The environment whose observation and action the exported policy has. Raises CruiseError if it cannot be had."""
    meta = policy.meta
    if track.variants:
        raise CruiseError(
            f"{track.name!r} is another track in every race: choose the one that the export of {meta.name!r} is "
            "compared on (--track)"
        )
    must_stand_still(track, f"the export of {meta.name!r} is compared on (--track)")
    env = make_race_env(track, meta.drones, find_vehicle(meta.vehicle), meta.observation)
    policy.pilot().init(env, tuple(range(meta.drones)), standing(env))
    return env


def standing(env: RaceEnv) -> Any:
    """One race of an environment, as shapes."""
    return jax.eval_shape(env.reset, jax.random.key(0))


def make_contract(policy: Policy, track: Track, env: RaceEnv, interface: Interface, model: Model) -> Contract:
    """The contract of a policy."""
    meta = policy.meta
    size = policy.params.shape.observation_size
    layout = env.layout(meta.observation)
    entries, first = [], 0
    for entry in layout:
        entries.append(ObservationEntry(first=first, **dataclasses.asdict(entry)))
        first += entry.size
    assert first == size
    return Contract(
        format=FORMAT_VERSION,
        interface=interface,
        policy=meta,
        control_dt=env.dynamics.control_dt,
        inputs=model.inputs,
        outputs=model.outputs,
        observation=tuple(entries),
        gates=tuple(ExportedGate(gate.position_w, gate.yaw, *gate.size, gate.roll, gate.pitch) for gate in track.gates),
    )
