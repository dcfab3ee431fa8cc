"""A PID pilot: flies through gate after gate by three gains, and gives way to drones close by.

    cruise race --track ring --pilot examples/pid_pilot.py:Pilot
    cruise race --track figure-eight --drones 2 --pilot examples/pid_pilot.py:Pilot --pilot chaser

The wanted velocity leads through the next gate; a PID controller on its error gives the acceleration.
"""

import numpy as np

SPEED = 2.8  # towards the gate [m/s]
KP, KI, KD = 0.8, 0.02, 0.01  # on the error of velocity [s/m], [1/m], [s^2/m]
MOST = 2.0  # the integral is held within this [m]
CLEARANCE, PUSH = 1.5, 2.0  # give way to drones nearer than this [m], so strongly [1/s]
FLOOR = 0.4  # never sink faster than the way down to this height [m]


class Pilot:
    """One drone; its integral and the error before are its own."""

    name = "PID"
    agility = 7.5

    def __init__(self):
        self.integral = np.zeros(3)
        self.error = None

    def act(self, view):
        error = self.wanted(view) - view.velocity_w
        change = np.zeros(3) if self.error is None else (error - self.error) / view.control_dt
        self.integral = np.clip(self.integral + error * view.control_dt, -MOST, MOST)
        self.error = error
        return np.clip(KP * error + KI * self.integral + KD * change, -1.0, 1.0)

    def wanted(self, view):
        """Velocity towards a point on the gate's axis, and away from others [m/s]."""
        velocity = SPEED * unit(aim_point(view) - view.position_w) + push_apart(view)
        velocity[2] = max(velocity[2], FLOOR - view.position_w[2])
        return velocity


def aim_point(view):
    """On the gate's axis: before the gate while far, behind it when near; beside it when it was missed [m]."""
    gate, normal = view.gates.position_w[view.next_gate], view.gates.normal_w[view.next_gate]
    offset = view.position_w - gate
    along = offset @ normal
    across = offset - along * normal
    if along > max(-0.1, 0.1 - np.abs(across).max()):  # beside or behind it: back, and around on this side
        left = np.array([-normal[1], normal[0], 0.0])
        return gate - 3.0 * normal + (3.0 * left if across @ left > 0 else -3.0 * left)
    return gate + (1.0 - 0.5 * np.linalg.norm(offset)) * normal


def push_apart(view):
    """Velocity away from drones that are too near [m/s]."""
    push = np.zeros(3)
    for other in view.others_position_w[view.others_airborne]:
        offset = view.position_w - other
        push += PUSH * max(CLEARANCE - np.linalg.norm(offset), 0.0) * unit(offset)
    return push


def unit(vector):
    """A vector of length 1."""
    return vector / max(np.linalg.norm(vector), 1e-6)
