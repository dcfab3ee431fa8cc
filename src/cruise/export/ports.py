"""Inputs and outputs of an exported pilot: names, shapes, units, frames; and what its actions command."""

import functools
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.actions import Action
from cruise.config import Vehicle
from cruise.dynamics import DroneState, Dynamics, make_dynamics
from cruise.dynamics.cascade import commanded_acceleration, velocity_error
from cruise.dynamics.references import reference_of
from cruise.env.observation import find_observation
from cruise.env.race_env import RaceEnv
from cruise.storage.onnx_file import PREVIOUS, Port
from cruise.storage.policy_file import Policy

OWN = (  # of a state, where a vehicle has it
    Port("position_w", ("B", "3"), "float32", "m", "world", "own position"),
    Port("velocity_w", ("B", "3"), "float32", "m/s", "world", "own velocity"),
    Port("attitude", ("B", "4"), "float32", "", "body to world", "own unit quaternion (w, x, y, z)"),
    Port("euler", ("B", "3"), "float32", "rad", "world to body", "own roll, pitch, yaw (ZYX)"),
    Port("angular_velocity_b", ("B", "3"), "float32", "rad/s", "body", "own roll, pitch and yaw rate (p, q, r)"),
)
POLES = "pole_position_w"
WHERE_NEEDED = ("gate_size", "gate_tilt")  # inputs that are there only if the action depends on them


class Sizes(NamedTuple):
    """Of the axes of an exported pilot's inputs: a number, or the letter that stands for any."""

    others: Any
    gates: Any


class Commands(NamedTuple):
    """What an action of a vehicle means outside."""

    meaning: str
    first: str  # what counts as the action before the first
    ports: tuple[Port, ...]  # what it commands
    function: str  # of the C header that gives them, in one array of this name
    array: str
    said: str  # there


ACCELERATION = Commands(
    "in [-1, 1]; wanted velocity = velocity + agility x action x control_dt",
    "0 at first",
    (
        Port(
            *("acceleration_w", ("B", "3"), "float32", "m/s^2", "world"),
            "that the paper's velocity loop commands for it, without gravity",
        ),
    ),
    *("acceleration", "acceleration_w"),
    "What the paper's velocity loop commands for the action, gravity apart [m/s^2], world. It is flown as thrust\n"
    " * mass * (g + a_z) >= 0, roll -a_y / g, pitch a_x / g.",
)
THRUST_AND_RATES = Commands(
    "collective thrust and three rates, in [-1, 1]",
    "(2 x gravity / agility - 1, 0, 0, 0), which hovers, at first",
    (
        Port("thrust", ("B",), "float32", "m/s^2", "body", "collective, per mass: agility x (action[0] + 1) / 2"),
        Port("body_rates_b", ("B", "3"), "float32", "rad/s", "body", "wanted p, q, r: action[1:] x the highest rates"),
    ),
    *("command", "command"),
    "Collective thrust per mass [m/s^2], then roll, pitch and yaw rate [rad/s], for the vehicle's rate loop.",
)


def commands_of(vehicle: Vehicle) -> Commands:
    """What the actions of a vehicle mean."""
    told = {"acceleration": ACCELERATION, "ctbr": THRUST_AND_RATES} if vehicle.told_directly else {}
    return told.get(vehicle.control) or _as_declared(vehicle.action)


def _as_declared(action: Action) -> Commands:
    """Every number of an action in its unit."""
    numbers = action.numbers
    first = f"({', '.join(f'{number:.6g}' for number in action.neutral)}), which hovers, at first"
    return Commands(
        f"{', '.join(one.name for one in numbers)}, in [-1, 1]",
        first,
        tuple(Port(one.name, ("B",), "float32", one.unit, action.frame, one.meaning) for one in numbers),
        *("command", "command"),
        "What the action stands for:\n" + "\n".join(f" * {one.name} [{one.unit}]: {one.meaning}" for one in numbers),
    )


def command(env: RaceEnv, agility: float, values: dict[str, Array], action: Float[Array, "A *B"]) -> dict[str, Array]:
    """What the vehicle's loops make of an action; `values` is the state, by the names of the ports."""
    vehicle = env.vehicle
    if commands_of(vehicle) is not ACCELERATION:
        numbers = replace(vehicle, agility=agility).action.numbers
        asked = [one.low + (one.high - one.low) * (a + 1) / 2 for one, a in zip(numbers, action, strict=True)]
        if vehicle.control == "ctbr":
            return {"thrust": asked[0], "body_rates_b": jnp.stack(asked[1:])}
        return {one.name: value for one, value in zip(numbers, asked, strict=True)}
    given = (action, values["previous_action"])
    error, before = (velocity_error(one, agility, vehicle.control_dt) for one in given)
    return {"acceleration_w": commanded_acceleration(vehicle, error, before, values["velocity_w"])}


@functools.cache
def own_dynamics(vehicle: Vehicle) -> Dynamics:
    """The vehicle without what follows a reference around its own loop."""
    return make_dynamics(vehicle.own)


def tracking(vehicle: Vehicle, drones: DroneState, action: Array, agility: float) -> dict[str, Array]:
    """By name, what is made of an action for the vehicle's own loop [K, *B]; nothing where the action is that."""
    if vehicle.told_directly:
        return {}
    reference = reference_of(vehicle, drones, action, agility)
    return {"tracking": own_dynamics(vehicle).track(drones, reference, agility)}


def sees_poles(env: RaceEnv, observation: str) -> bool:
    """Whether an observation of CRUISE's own looks at poles, and there are some."""
    there = "pole" in (env.course.solids or {})
    return there and any(entry.name.startswith("pole_") for entry in env.layout(observation))


def said_ports(policy: Policy, env: RaceEnv) -> tuple[Port, ...]:
    """What the pilot says, beside what that commands: its action, and what it is to be told of at the next step."""
    vehicle = env.vehicle
    ports = [_numbers("action", vehicle.action, commands_of(vehicle).meaning)]
    if not vehicle.told_directly:
        inner = commands_of(vehicle.own).meaning
        ports.append(_numbers("tracking", vehicle.own.action, f"what CRUISE's own loop makes of the action: {inner}"))
    return (*ports, *memory_ports(policy))


def memory_ports(policy: Policy) -> tuple[Port, ...]:
    """What a network with a memory remembers."""
    size = policy.params.shape.memory_size
    return (Port("memory", ("B", str(size)), "float32", "", "", "what the network remembers"),) if size else ()


def fed_back(ports: tuple[Port, ...], vehicle: Vehicle) -> tuple[Port, ...]:
    """The inputs that are such outputs of one control step before."""
    own = vehicle.own
    first = {"action": (own.action.neutral, commands_of(own).first), "memory": ((0.0,), "0 at first")}
    first["tracking"] = first["action"]
    known = [port for port in ports if port.name != "action" or vehicle.told_directly]
    return tuple(_previous(port, *first[port.name]) for port in known)


def _previous(port: Port, first: tuple[float, ...], said: str) -> Port:
    first = first if len(first) > 1 else first * int(port.shape[1])
    meaning = f"the output `{port.name}` one control step before; {said}"
    return replace(port, name=PREVIOUS + port.name, meaning=meaning, first=first)


def _numbers(name: str, action: Action, meaning: str) -> Port:
    return Port(name, ("B", str(action.size)), "float32", "", action.frame, meaning)


def state_ports(policy: Policy, env: RaceEnv, fields: tuple[str, ...], sizes: Sizes) -> tuple[Port, ...]:
    """Inputs of the whole pilot, in order. `fields` are those of the vehicle's body."""
    meta, others = policy.meta, str(sizes.others)
    order = "own number + 1 first and around" if others.isdigit() else "any number in any order"
    seen = (
        Port("others_position_w", ("B", others, "3"), "float32", "m", "world", f"the others, {order}"),
        Port("others_velocity_w", ("B", others, "3"), "float32", "m/s", "world", "in the same order"),
        Port("others_airborne", ("B", others), "bool", "", "", "false for one that left the air: it is not seen"),
    )
    gates = str(sizes.gates)
    poles = str(env.course.solids["pole"].shape[1]) if env.course.solids and sees_poles(env, meta.observation) else ""
    feet = Port(POLES, (poles, "3"), "float32", "m", "world", "feet of the poles, in the order of the track")
    lean = "roll about the direction of flight and its pitch below the horizon; 0, 0 where a gate stands upright"
    return (
        *(port for port in OWN if port.name in fields),
        *fed_back(said_ports(policy, env), env.vehicle),
        Port("next_gate", ("B",), "int64", "", "", "index of the gate to pass next"),
        *(seen if meta.drones > 1 else ()),
        Port("gate_position_w", (gates, "3"), "float32", "m", "world", "centres of the gates, in the order of flight"),
        Port("gate_yaw", (gates,), "float32", "rad", "world", "headings of the direction of flight through them"),
        Port("gate_size", (gates, "2"), "float32", "m", "", "widths and heights of the openings"),
        *((Port("gate_tilt", (gates, "2"), "float32", "rad", "world", lean),) if env.course.tilt is not None else ()),
        *((feet,) if poles else ()),
    )


def observation_port(size: int) -> Port:
    """Input of the bare network."""
    return Port(
        "observation", ("B", str(size)), "float32", "", "see observation", "scaled and clipped; see observation"
    )


def network_action(observation: str, env: RaceEnv) -> Port:
    """Output of the bare network on a kind of observation."""
    said = ", ".join(one.name.replace("_", " ") for one in env.vehicle.action.numbers)
    frame, turned, size = f"body: {said}", "", str(env.dynamics.action_size)
    if env.dynamics.action_frame == "world":
        frame = NETWORK_FRAMES[find_observation(observation).action_frame == "gate"]
        turned = " only after it is turned into the world"
    return Port("action", ("B", size), "float32", "", frame, f"to be clipped to [-1, 1]{turned}")


NETWORK_FRAMES = ("world", "gate: forward, left, up of the target gate")


def output_ports(policy: Policy, env: RaceEnv) -> tuple[Port, ...]:
    """Outputs of the whole pilot."""
    return (*said_ports(policy, env), *commands_of(env.vehicle).ports)
