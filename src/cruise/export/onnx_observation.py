"""The observations of the paper's vehicle as ONNX nodes, from the state in SI units. Batch axis B leads."""

import numpy as np

from cruise.dynamics.cascade import AGILITY_SCALE, RATE_SCALE
from cruise.env import observation_extended as env
from cruise.env import observation_paper as printed
from cruise.env.view import ABSENT
from cruise.export.onnx_state import StateInputs, gate_ahead, heading_of, nearest_first, noticed, pick
from cruise.export.onnx_values import Graph, Value
from cruise.terms import LIMIT


def gate_rotation(g: Graph, state: StateInputs) -> Value:
    """[B, 3, 3] turns world vectors, as rows, into the frame of the target gate."""
    yaw = heading_of(g, state, state.next_gate)
    cos, sin = g.node("Cos", yaw), g.node("Sin", yaw)
    zero = cos * 0.0
    return g.shaped(g.join([cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1.0]), -1, 3, 3)


def rotated(g: Graph, vectors: list[Value], rotation: Value) -> list[Value]:
    """World vectors [B, 3] turned."""
    turned = g.stack(vectors) @ rotation
    return [g.squeeze(g.part(turned, i, i + 1, axis=1), 1) for i in range(len(vectors))]


def extended(g: Graph, state: StateInputs, agility: float) -> Value:
    """[B, O] as `cruise.env.observation.extended_observation`; the vehicle is the paper's."""
    gates = [state.next_gate, *(gate_ahead(g, state, ahead) for ahead in (1, 2))]
    target, second, third = (pick(g, state.gates, gate) for gate in gates)
    next_yaw = heading_of(g, state, gates[1])
    next_normal = g.join([g.node("Cos", next_yaw), g.node("Sin", next_yaw), next_yaw * 0.0])
    rotation = gate_rotation(g, state)
    world = [state.position - target, second - target, third - second, next_normal, state.velocity, *_felt(g, state)]
    place, to_second, to_third, normal, velocity, thrust, rates, previous = rotated(g, world, rotation)
    distance = g.norm(place)
    time = g.clip(-g.part(place, 0, 1) / g.largest(g.part(velocity, 0, 1), env.MIN_CLOSING_SPEED), 0.0, env.LOOK_AHEAD)
    parts = [
        place / env.GATE_RANGE,
        distance / printed.DISTANCE_MAX,
        to_second / printed.DISTANCE_MAX,
        to_third / printed.DISTANCE_MAX,
        g.part(normal, 0, 2),
        velocity / env.SPEED_RANGE,
        -g.dot(velocity, place) / (distance + printed.EPSILON) / env.SPEED_RANGE,
        g.part(state.position, 2, 3) / env.HEIGHT_RANGE,
        (g.part(place, 1, 3) + g.part(velocity, 1, 3) * time) / 2.0,
        time / env.LOOK_AHEAD,
        thrust,
        rates / RATE_SCALE,
        previous * (agility / AGILITY_SCALE),  # agility x action x control_dt over AGILITY_SCALE x control_dt
    ]
    if state.others_position is not None:
        parts.append(_nearest_first(g, state, rotation))
    return g.clip(g.join(parts), -LIMIT, LIMIT)


def _felt(g: Graph, state: StateInputs) -> list[Value]:
    """Thrust axis, rates turned level by the yaw, previous action; in the world."""
    assert state.euler is not None
    roll, pitch, yaw = (g.part(state.euler, i, i + 1) for i in range(3))
    (sin_r, cos_r), (sin_p, cos_p), (sin_y, cos_y) = ((g.node("Sin", a), g.node("Cos", a)) for a in (roll, pitch, yaw))
    thrust = g.join([cos_y * sin_p * cos_r + sin_y * sin_r, sin_y * sin_p * cos_r - cos_y * sin_r, cos_p * cos_r])
    p, q, r = (g.part(state.rates, i, i + 1) for i in range(3))
    level = g.join([cos_y * p - sin_y * q, sin_y * p + cos_y * q, r])
    return [thrust, level, g.clip(state.previous_action, -1.0, 1.0)]


def _nearest_first(g: Graph, state: StateInputs, rotation: Value) -> Value:
    """[B, 9 (N - 1)] opponents, zeros for those that left the air."""
    assert state.others_position is not None
    assert state.others_velocity is not None
    assert state.others_airborne is not None
    offset = state.others_position - g.expand(state.position, 1)
    motion = state.others_velocity - g.expand(state.velocity, 1)
    separation = g.norm(offset)
    time = g.clip(-g.dot(offset, motion) / g.largest(g.dot(motion, motion), 0.01), 0.0, env.LOOK_AHEAD)
    features = g.join(
        [
            offset @ rotation / env.OPPONENT_RANGE,
            motion @ rotation / env.OPPONENT_RANGE,
            g.node("Exp", -separation),
            time / env.LOOK_AHEAD,
            g.node("Exp", -g.norm(offset + motion * time)),
        ],
        axis=2,
    )
    here = g.expand(state.others_airborne, 2)
    features = noticed(g, separation, env.NOTICE) * g.clip(features, -LIMIT, LIMIT)
    seen = g.node("Where", here, features, 0.0 * features, kind=np.float32)
    ranked = g.node("Where", here, separation, 0.0 * separation + ABSENT, kind=np.float32)
    everybody = g.part(g.node("Shape", seen, kind=np.int64), 1, 2, axis=0)
    return g.shaped(nearest_first(g, ranked, seen, everybody), 0, -1)


def paper(g: Graph, state: StateInputs, num_gates: int) -> Value:
    """[B, O] as `cruise.env.observation.paper_observation`."""
    assert state.euler is not None
    to_gate = pick(g, state.gates, state.next_gate) - state.position
    distance = g.norm(to_gate)
    turned = g.part(state.euler, 2, 3) - heading_of(g, state, state.next_gate)
    numbers = g.constant(np.arange(num_gates, dtype=np.int64)[None])
    one_hot = g.node("Cast", g.node("Equal", g.expand(state.next_gate, 1), numbers), kind=np.float32, to=1)
    parts = [
        to_gate / printed.DISTANCE_MAX,
        distance / printed.DISTANCE_MAX,
        state.velocity / printed.SPEED_MAX,
        g.dot(state.velocity, to_gate) / (distance + printed.EPSILON) / printed.SPEED_MAX,
        one_hot,
        state.position / printed.DISTANCE_MAX,
        g.node("Sin", turned),
        g.node("Cos", turned),
    ]
    if state.others_position is not None:
        assert state.others_airborne is not None
        offset = state.others_position - g.expand(state.position, 1)
        here = g.expand(state.others_airborne, 2)
        offset = g.node("Where", here, offset, 0.0 * offset, kind=np.float32)
        separation = g.norm(offset) / printed.DISTANCE_MAX
        far = g.node("Where", here, separation, 0.0 * separation + 1.0, kind=np.float32)
        parts += [g.shaped(offset / printed.DISTANCE_MAX, 0, -1), g.shaped(far, 0, -1)]
    return g.clip(g.join(parts), -1.0, 1.0)
