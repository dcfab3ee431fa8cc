"""Which gate comes next aboard a drone, and what a flight's log is."""

import numpy as np

from cruise.companion.policy import OnnxPolicy
from cruise.geometry import from_gate, heading_of
from cruise.presets import TRACKS


def test_gates_count_where_the_way_goes_through_the_opening_forward():
    policy = OnnxPolicy.__new__(OnnxPolicy)  # no model: gates alone
    policy.track, policy.next_gate, policy._before = TRACKS["ring"], 0, None

    def fly(*offsets):
        gate = policy.track.gates[policy.next_gate]
        for offset in offsets:
            policy._pass_gates(np.array(gate.position_w) + from_gate(heading_of(gate.yaw), offset))
        return policy.next_gate

    assert fly((-1.0, 0.0, 0.0), (-0.1, 0.0, 0.0)) == 0
    assert fly((-1.0, 1.5, 0.0), (1.0, 1.5, 0.0)) == 0  # beside it
    assert fly((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)) == 0  # backwards
    assert fly((-1.0, 1.5, 0.0), (0.5, 0.0, 0.0)) == 1  # through it, aslant
    for expected in (2, 3, 4, 0):
        assert fly((-1.0, 0.0, 0.5), (1.0, 0.0, 0.5)) == expected
