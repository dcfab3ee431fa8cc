"""The observation from a drone's own seat as ONNX nodes, and what its action commands. Batch axis B leads."""

import math

import numpy as np

from cruise.config import Airframe
from cruise.env import observation_body as env
from cruise.env.view import ABSENT
from cruise.export.onnx_state import StateInputs, gate_ahead, heading_of, nearest_first, noticed, pick
from cruise.export.onnx_values import Graph, Value
from cruise.terms import LIMIT

CORNERS = ((1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0))  # left, up


def body(g: Graph, state: StateInputs, airframe: Airframe, notice: float) -> Value:
    """[B, O] as `cruise.env.observation_body.body_observation`."""
    turn = _rotation(g, state)
    own, opponents = g.stack([state.velocity]) @ turn, _opponents(g, state, turn)
    parts = [
        *(_corners(g, state, turn, gate_ahead(g, state, ahead)) for ahead in range(env.GATES_AHEAD)),
        g.squeeze(own, 1) / env.SPEED_RANGE,
        g.squeeze(g.part(turn, 2, 3, axis=1), 1),  # up
        state.rates / np.array([airframe.rates.highest], np.float32),
        g.clip(state.previous_action, -1.0, 1.0),
        g.part(state.position, 2, 3) / env.HEIGHT_RANGE,
        g.shaped(opponents if math.isinf(notice) else _faded(g, opponents, notice), 0, -1),
    ]
    return g.clip(g.join(parts), -LIMIT, LIMIT)


def command(g: Graph, action: Value, airframe: Airframe, agility: float) -> tuple[Value, Value]:
    """Collective thrust per mass [B] and body rates [B, 3], as `cruise.dynamics.quadrotor.setpoint`."""
    thrust = (g.part(action, 0, 1) + 1.0) * (agility / 2)
    return g.squeeze(thrust, 1), g.part(action, 1, 4) * np.array([airframe.rates.highest], np.float32)


def _rotation(g: Graph, state: StateInputs) -> Value:
    """[B, 3, 3] R_WB of the quaternion: a row in the world times it is along the body's axes."""
    assert state.attitude is not None
    w, x, y, z = (g.part(state.attitude, i, i + 1) for i in range(4))
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return g.stack([g.join(row) for row in rows])


def _corners(g: Graph, state: StateInputs, turn: Value, gate: Value) -> Value:
    """[B, 12] from the drone to the corners of a gate's opening."""
    assert state.gate_size is not None
    centre = pick(g, state.gates, gate) - state.position
    yaw, half = heading_of(g, state, gate), pick(g, state.gate_size, gate) / 2.0
    aside, above = g.part(half, 0, 1), g.part(half, 1, 2)
    zero = above * 0.0
    left = g.join([-g.node("Sin", yaw) * aside, g.node("Cos", yaw) * aside, zero])
    up = g.join([zero, zero, above])
    corners = g.stack([centre + left * sideways + up * upwards for sideways, upwards in CORNERS])
    return g.shaped(corners @ turn, 0, -1) / env.CORNER_RANGE


def _opponents(g: Graph, state: StateInputs, turn: Value) -> Value:
    """[B, 3, 7] the nearest, nearest first; zeros where there are fewer."""
    zero = g.expand(g.part(state.position, 0, 1) * 0.0, 2)
    nobody = g.join([g.join([zero] * env.OPPONENT_SIZE, axis=2)] * env.NEAREST)
    if state.others_position is None:
        return nobody
    assert state.others_velocity is not None
    assert state.others_airborne is not None
    offset = state.others_position - g.expand(state.position, 1)
    motion = state.others_velocity - g.expand(state.velocity, 1)
    separation = g.norm(offset)
    here = g.expand(state.others_airborne, 2)
    present = separation * 0.0 + 1.0
    features = g.join([offset @ turn / env.OPPONENT_RANGE, motion @ turn / env.SPEED_RANGE, present], axis=2)
    seen = g.join([g.node("Where", here, features, features * 0.0, kind=np.float32), nobody])
    far = g.join([zero + ABSENT] * env.NEAREST)
    ranked = g.join([g.node("Where", here, separation, separation * 0.0 + ABSENT, kind=np.float32), far])
    return nearest_first(g, ranked, seen, g.constant(np.array([env.NEAREST], np.int64)))


def _faded(g: Graph, opponents: Value, notice: float) -> Value:
    """[B, 3, 7] less of who is farther away."""
    separation = g.norm(g.part(opponents, 0, 3)) * env.OPPONENT_RANGE
    return noticed(g, separation, notice) * opponents
