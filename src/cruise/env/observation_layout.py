"""What the numbers of an observation mean, in their order: for spaces, exported policies and whoever reads them."""

import math
from typing import NamedTuple

from cruise.config import ObservationKind
from cruise.env import observation_body as body
from cruise.env.observation import (
    DISTANCE_MAX,
    GATE_RANGE,
    HEIGHT_RANGE,
    LIMIT,
    LOOK_AHEAD,
    OPPONENT_RANGE,
    SPEED_MAX,
    SPEED_RANGE,
)


class Entry(NamedTuple):
    """Some numbers of an observation that belong together: a quantity divided by its scale, then clipped."""

    name: str
    size: int
    quantity: str
    unit: str
    scale: float
    frame: str  # world: x, y, z up; gate: forward, left, up of the target gate; body: forward, left, up of the drone
    low: float  # bounds after scale and clip
    high: float


FELT: dict[str, tuple[tuple[str, str, str, float], ...]] = {
    "paper": (
        ("thrust_axis", "the body's z axis: where its thrust points", "", 1.0),
        ("body_rates", "roll and pitch rate turned level by the yaw alone, yaw rate", "rad/s", 3.0),
        ("previous_velocity_error", "agility x previous action x control_dt, the controller's memory", "m/s", 0.4),
    )
}  # proprioception by vehicle: name, quantity, unit, scale


def observation_layout(kind: ObservationKind, drones: int, gates: int, vehicle: str, size: int) -> tuple[Entry, ...]:
    """The entries of an observation.

    Args:
        kind: of observation.
        drones: in the race.
        gates: of the track.
        vehicle: name of the preset, for what the drone feels.
        size: of the observation: what no entry explains, the vehicle feels.
    """
    if kind == "paper":
        return _paper(drones, gates)
    if kind in body.NOTICE:
        return _body(size, body.NOTICE[kind])
    without = sum(entry.size for entry in _extended(drones, vehicle, 0))
    return _extended(drones, vehicle, (size - without) // 3)


def _paper(drones: int, gates: int) -> tuple[Entry, ...]:
    def entry(name: str, size: int, quantity: str, unit: str, scale: float, low: float = -1.0) -> Entry:
        return Entry(name, size, quantity, unit, scale, "world", low, 1.0)

    return (
        entry("to_gate", 3, "target gate's centre minus position", "m", DISTANCE_MAX),
        entry("distance", 1, "to the target gate's centre", "m", DISTANCE_MAX, low=0.0),
        entry("velocity", 3, "velocity", "m/s", SPEED_MAX),
        entry("closing_speed", 1, "velocity along the line to the gate", "m/s", SPEED_MAX),
        entry("target", gates, "1 at the target gate, 0 at the others", "", 1.0, low=0.0),
        entry("position", 3, "position", "m", DISTANCE_MAX),
        entry("heading_error", 2, "sine and cosine of yaw minus the gate's yaw", "", 1.0),
        *(
            entry(f"opponent_{k}_offset", 3, "opponent's position minus own", "m", DISTANCE_MAX)
            for k in range(1, drones)
        ),
        *(entry(f"opponent_{k}_distance", 1, "to it", "m", DISTANCE_MAX, low=0.0) for k in range(1, drones)),
    )


def _extended(drones: int, vehicle: str, proprioception: int) -> tuple[Entry, ...]:
    def entry(name: str, size: int, quantity: str, unit: str, scale: float, low: float = -LIMIT) -> Entry:
        return Entry(name, size, quantity, unit, scale, "gate", low, LIMIT)

    felt = FELT.get(vehicle, ())
    if len(felt) != proprioception:
        felt = tuple((f"felt_{i}", "what the vehicle feels of itself", "", 1.0) for i in range(1, proprioception + 1))
    return (
        entry("place", 3, "position minus the target gate's centre", "m", GATE_RANGE),
        entry("distance", 1, "to the target gate's centre", "m", DISTANCE_MAX, low=0.0),
        entry("second_gate", 3, "the gate after the target minus the target", "m", DISTANCE_MAX),
        entry("third_gate", 3, "the one after that minus the second", "m", DISTANCE_MAX),
        entry("second_normal", 2, "normal of the second gate, forward and left", "", 1.0),
        entry("velocity", 3, "velocity", "m/s", SPEED_RANGE),
        entry("closing_speed", 1, "velocity along the line to the gate", "m/s", SPEED_RANGE),
        entry("height", 1, "above the ground", "m", HEIGHT_RANGE),
        entry("crossing", 2, "where, left and up, the gate's plane would be crossed at this velocity", "m", 2.0),
        entry("crossing_time", 1, "and when", "s", LOOK_AHEAD, low=0.0),
        *(entry(name, 3, quantity, unit, scale) for name, quantity, unit, scale in felt),
        *(one for place in range(1, drones) for one in _opponent(place)),
    )


def _opponent(place: int) -> tuple[Entry, ...]:
    def entry(name: str, size: int, quantity: str, unit: str, scale: float, low: float = -LIMIT) -> Entry:
        return Entry(f"opponent_{place}_{name}", size, quantity, unit, scale, "gate", low, LIMIT)

    return (
        entry(
            "offset",
            3,
            "position minus own; opponents nearest first, zeros for one that left the air; all of it, when clipped, "
            "fades from whole at 2.5 m to nothing at 5 m",
            "m",
            OPPONENT_RANGE,
        ),
        entry("motion", 3, "velocity minus own", "m/s", OPPONENT_RANGE),
        entry("closeness", 1, "exp(-distance / 1 m)", "", 1.0, low=0.0),
        entry("approach_time", 1, "until the two are nearest at constant velocities", "s", LOOK_AHEAD, low=0.0),
        entry("approach_closeness", 1, "exp(-distance / 1 m) then", "", 1.0, low=0.0),
    )


def _nearest_first(notice: float) -> str:
    fading = f"; all of it fades from whole at {notice / 2:g} m to nothing at {notice:g} m"
    return "position minus own, the nearest first" + (fading if math.isfinite(notice) else "")


def _body(size: int, notice: float) -> tuple[Entry, ...]:
    def entry(name: str, numbers: int, quantity: str, unit: str, scale: float, low: float = -body.LIMIT) -> Entry:
        return Entry(name, numbers, quantity, unit, scale, "body", low, body.LIMIT)

    gates = (
        entry(f"gate_{ahead}_{corner}", 3, "from the drone to this corner of the opening", "m", body.CORNER_RANGE)
        for ahead in range(1, body.GATES_AHEAD + 1)
        for corner in ("upper_left", "lower_left", "lower_right", "upper_right")
    )
    nearest = (
        one
        for place in range(1, body.NEAREST + 1)
        for one in (
            entry(f"opponent_{place}_offset", 3, _nearest_first(notice), "m", body.OPPONENT_RANGE),
            entry(f"opponent_{place}_motion", 3, "velocity minus own", "m/s", body.SPEED_RANGE),
            entry(f"opponent_{place}_present", 1, "1; 0, as all of it, where there is none", "", 1.0, low=0.0),
        )
    )
    seen = (
        *gates,
        entry("velocity", 3, "own velocity", "m/s", body.SPEED_RANGE),
        entry("up", 3, "the world's up", "", 1.0),
        entry("height", 1, "above the ground", "m", body.HEIGHT_RANGE),
        *nearest,
    )
    felt = size - sum(one.size for one in seen)
    place = next(i for i, one in enumerate(seen) if one.name == "height")
    return (*seen[:place], *(entry(*one) for one in _felt(felt)), *seen[place:])


def _felt(size: int) -> tuple[tuple[str, int, str, str, float], ...]:
    """What a vehicle feels of itself: of one flown by thrust and body rates it is known what that is."""
    if size != 7:
        return (("felt", size, "what the vehicle feels of itself", "", 1.0),)
    return (
        ("body_rates", 3, "roll, pitch and yaw rate over the highest that can be asked for", "", 1.0),
        ("previous_action", 4, "the action one control step before", "", 1.0),
    )
