"""What goes into an exported policy and what comes out: names, shapes, units, frames."""

from typing import Any

import jax

from cruise.config import Track
from cruise.env.observation_layout import observation_layout
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.errors import CruiseError
from cruise.presets import VEHICLES
from cruise.storage.onnx_file import FORMAT_VERSION, Contract, ExportedGate, Interface, ObservationEntry, Port
from cruise.storage.policy_file import Policy

SUPPORTED = ("paper",)  # vehicles whose state the exported observation is built from
OBSERVATIONS = ("extended", "paper")


def export_env(policy: Policy, track: Track) -> RaceEnv:
    """The environment whose observation and action the exported policy has. Raises CruiseError if it cannot be had."""
    meta = policy.meta
    if meta.vehicle not in SUPPORTED:
        raise CruiseError(
            f"policy {meta.name!r} flies vehicle {meta.vehicle!r}; only {', '.join(SUPPORTED)} can be exported"
        )
    if meta.observation not in OBSERVATIONS:
        names = ", ".join(OBSERVATIONS)
        raise CruiseError(
            f"policy {meta.name!r} sees the observation {meta.observation!r}; only {names} can be exported"
        )
    env = make_race_env(track, meta.drones, VEHICLES[meta.vehicle], meta.observation)
    policy.pilot().init(env, tuple(range(meta.drones)), standing(env))
    return env


def standing(env: RaceEnv) -> Any:
    """One race of an environment, as shapes."""
    return jax.eval_shape(env.reset, jax.random.key(0))


def make_contract(policy: Policy, track: Track, env: RaceEnv, interface: Interface) -> Contract:
    """The contract of a policy."""
    meta = policy.meta
    size = int(policy.params.actor.layers[0].in_features)
    layout = observation_layout(meta.observation, meta.drones, len(track.gates), meta.vehicle, size)
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
        inputs=state_ports(meta.drones) if interface == "state" else (_observation_port(first),),
        outputs=(_world_action(), _acceleration()) if interface == "state" else (_network_action(meta.observation),),
        observation=tuple(entries),
        gates=tuple(ExportedGate(gate.position_w, gate.yaw, gate.width, gate.height) for gate in track.gates),
    )


def state_ports(drones: int) -> tuple[Port, ...]:
    """Inputs of the whole pilot, in order."""
    others = str(drones - 1)
    own = (
        Port("position_w", ("B", "3"), "float32", "m", "world", "own position"),
        Port("velocity_w", ("B", "3"), "float32", "m/s", "world", "own velocity"),
        Port("euler", ("B", "3"), "float32", "rad", "world to body", "own roll, pitch, yaw (ZYX)"),
        Port("angular_velocity_b", ("B", "3"), "float32", "rad/s", "body", "own roll, pitch and yaw rate (p, q, r)"),
        Port(
            "previous_action",
            ("B", "3"),
            "float32",
            "",
            "world",
            "the output `action` one control step before; 0 at first",
        ),
        Port("next_gate", ("B",), "int64", "", "", "index of the gate to pass next"),
    )
    opponents = (
        Port(
            "others_position_w",
            ("B", others, "3"),
            "float32",
            "m",
            "world",
            "the others, own number + 1 first and around",
        ),
        Port("others_velocity_w", ("B", others, "3"), "float32", "m/s", "world", "in the same order"),
        Port("others_airborne", ("B", others), "bool", "", "", "false for one that left the air: it is not seen"),
    )
    gates = (
        Port("gate_position_w", ("G", "3"), "float32", "m", "world", "centres of the gates, in the order of flight"),
        Port("gate_yaw", ("G",), "float32", "rad", "world", "headings of the direction of flight through them"),
    )
    return own + (opponents if drones > 1 else ()) + gates


def _observation_port(size: int) -> Port:
    return Port(
        "observation", ("B", str(size)), "float32", "", "see observation", "scaled and clipped; see observation"
    )


def _network_action(kind: str) -> Port:
    frame = "world" if kind == "paper" else "gate: forward, left, up of the target gate"
    return Port("action", ("B", "3"), "float32", "", frame, "clipped to [-1, 1] only after it is turned into the world")


def _world_action() -> Port:
    return Port(
        "action",
        ("B", "3"),
        "float32",
        "",
        "world",
        "in [-1, 1]; wanted velocity = velocity + agility x action x control_dt",
    )


def _acceleration() -> Port:
    return Port(
        "acceleration_w",
        ("B", "3"),
        "float32",
        "m/s^2",
        "world",
        "that the paper's velocity loop commands for it, without gravity",
    )
