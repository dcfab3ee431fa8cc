"""What goes into an exported policy and what comes out, and the environment that it is compared in."""

from typing import Any

import jax

from cruise.config import Track
from cruise.env.observation_body import NOTICE
from cruise.env.observation_layout import observation_layout
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.errors import CruiseError
from cruise.export.ports import airframe_of, command_ports, network_action, observation_port, state_ports
from cruise.storage.onnx_file import FORMAT_VERSION, Contract, ExportedGate, Interface, ObservationEntry
from cruise.storage.policy_file import Policy
from cruise.vehicles import find_vehicle, name_of

OBSERVATIONS = {  # that are rebuilt, by what an action means
    "acceleration": ("extended", "paper"),
    "ctbr": tuple(NOTICE),
}


def export_env(policy: Policy, track: Track) -> RaceEnv:
    """The environment whose observation and action the exported policy has. Raises CruiseError if it cannot be had."""
    meta = policy.meta
    known = OBSERVATIONS["ctbr" if airframe_of(meta) else "acceleration"]
    if meta.observation not in known:
        raise CruiseError(
            f"policy {meta.name!r} flies vehicle {meta.vehicle!r} by the observation {meta.observation!r}; "
            f"exported can be {' and '.join(known)}"
        )
    if track.variants:
        raise CruiseError(
            f"{track.name!r} is another track in every race: choose the one that the export of {meta.name!r} is "
            "compared on (--track)"
        )
    env = make_race_env(track, meta.drones, find_vehicle(meta.vehicle), meta.observation)
    policy.pilot().init(env, tuple(range(meta.drones)), standing(env))
    return env


def standing(env: RaceEnv) -> Any:
    """One race of an environment, as shapes."""
    return jax.eval_shape(env.reset, jax.random.key(0))


def make_contract(policy: Policy, track: Track, env: RaceEnv, interface: Interface) -> Contract:
    """The contract of a policy."""
    meta = policy.meta
    size = int(policy.params.actor.layers[0].in_features)
    layout = observation_layout(meta.observation, meta.drones, len(track.gates), name_of(meta.vehicle), size)
    entries, first = [], 0
    for entry in layout:
        entries.append(ObservationEntry(first=first, **entry._asdict()))
        first += entry.size
    assert first == size
    return Contract(
        format=FORMAT_VERSION,
        interface=interface,
        policy=meta,
        control_dt=env.dynamics.control_dt,
        inputs=state_ports(meta) if interface == "state" else (observation_port(first),),
        outputs=command_ports(meta) if interface == "state" else (network_action(meta),),
        observation=tuple(entries),
        gates=tuple(ExportedGate(gate.position_w, gate.yaw, gate.width, gate.height) for gate in track.gates),
    )
