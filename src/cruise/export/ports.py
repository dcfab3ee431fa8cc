"""Inputs and outputs of an exported policy: names, shapes, units, frames."""

from cruise.config import Airframe
from cruise.env.observation_body import NOTICE
from cruise.storage.onnx_file import Port
from cruise.storage.policy_file import PolicyMeta
from cruise.vehicles import find_vehicle


def airframe_of(meta: PolicyMeta) -> Airframe | None:
    """Of a vehicle that is flown by thrust and body rates; None for the paper's, which is flown by accelerations."""
    return find_vehicle(meta.vehicle).airframe


def state_ports(meta: PolicyMeta) -> tuple[Port, ...]:
    """Inputs of the whole pilot, in order."""
    agile = airframe_of(meta) is not None
    own = (
        Port("position_w", ("B", "3"), "float32", "m", "world", "own position"),
        Port("velocity_w", ("B", "3"), "float32", "m/s", "world", "own velocity"),
        _attitude() if agile else _euler(),
        Port("angular_velocity_b", ("B", "3"), "float32", "rad/s", "body", "own roll, pitch and yaw rate (p, q, r)"),
        _previous_action(agile),
        Port("next_gate", ("B",), "int64", "", "", "index of the gate to pass next"),
    )
    gates = (
        Port("gate_position_w", ("G", "3"), "float32", "m", "world", "centres of the gates, in the order of flight"),
        Port("gate_yaw", ("G",), "float32", "rad", "world", "headings of the direction of flight through them"),
    )
    sizes = Port("gate_size", ("G", "2"), "float32", "m", "", "widths and heights of the openings")
    return own + _others(meta, agile) + gates + ((sizes,) if agile else ())


def _attitude() -> Port:
    return Port("attitude", ("B", "4"), "float32", "", "body to world", "own unit quaternion (w, x, y, z)")


def _euler() -> Port:
    return Port("euler", ("B", "3"), "float32", "rad", "world to body", "own roll, pitch, yaw (ZYX)")


def _previous_action(agile: bool) -> Port:
    first = "(2 x gravity / agility - 1, 0, 0, 0), which hovers, at first" if agile else "0 at first"
    frame = "body" if agile else "world"
    said = f"the output `action` one control step before; {first}"
    return Port("previous_action", ("B", "4" if agile else "3"), "float32", "", frame, said)


def _others(meta: PolicyMeta, agile: bool) -> tuple[Port, ...]:
    """Opponents: as many as in training for the paper's vehicle, any number M for one that sees only the nearest."""
    if meta.drones == 1:
        return ()
    count = "M" if agile else str(meta.drones - 1)
    order = "any number in any order" if agile else "own number + 1 first and around"
    return (
        Port("others_position_w", ("B", count, "3"), "float32", "m", "world", f"the others, {order}"),
        Port("others_velocity_w", ("B", count, "3"), "float32", "m/s", "world", "in the same order"),
        Port("others_airborne", ("B", count), "bool", "", "", "false for one that left the air: it is not seen"),
    )


def observation_port(size: int) -> Port:
    """Input of the bare network."""
    return Port(
        "observation", ("B", str(size)), "float32", "", "see observation", "scaled and clipped; see observation"
    )


NETWORK_FRAMES: dict[str, str] = {
    "paper": "world",
    "extended": "gate: forward, left, up of the target gate",
    **dict.fromkeys(NOTICE, "body: collective thrust, roll, pitch and yaw rate"),
}


def network_action(meta: PolicyMeta) -> Port:
    """Output of the bare network."""
    size, turned = ("4", "") if airframe_of(meta) else ("3", " only after it is turned into the world")
    frame = NETWORK_FRAMES[meta.observation]
    return Port("action", ("B", size), "float32", "", frame, f"to be clipped to [-1, 1]{turned}")


def command_ports(meta: PolicyMeta) -> tuple[Port, ...]:
    """Outputs of the whole pilot."""
    if airframe_of(meta) is None:
        meaning = "in [-1, 1]; wanted velocity = velocity + agility x action x control_dt"
        loop = "that the paper's velocity loop commands for it, without gravity"
        return (
            Port("action", ("B", "3"), "float32", "", "world", meaning),
            Port("acceleration_w", ("B", "3"), "float32", "m/s^2", "world", loop),
        )
    return (
        Port("action", ("B", "4"), "float32", "", "body", "collective thrust and three rates, in [-1, 1]"),
        Port("thrust", ("B",), "float32", "m/s^2", "body", "collective, per mass: agility x (action[0] + 1) / 2"),
        Port("body_rates_b", ("B", "3"), "float32", "rad/s", "body", "wanted p, q, r: action[1:] x the highest rates"),
    )
