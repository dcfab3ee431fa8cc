"""Steps that never flew, for the terms of a reward: any positions and velocities, any target gate."""

import jax.numpy as jnp

from cruise.dynamics import DroneState, RigidBody
from cruise.env.payment import make_reward
from cruise.env.step_view import StepView
from cruise.env.types import RaceState
from cruise.env.view import View
from cruise.racing.course import Opening
from cruise.racing.gates import Crossing


class GivenGate(View):
    """A view of drones whose target gate, and that before it, is given: its centre, heading and half size."""

    frame_width = 0.3

    def __init__(self, state, centre_w, heading_w, half_size):
        self.state, self._kept = state, {}
        self.opening = Opening(centre_w, heading_w, half_size)

    def gate(self, ahead=0):
        return self.opening


def crossing_of(passed, offset=0.0):
    """What a step did at its gate."""
    passed = jnp.asarray(passed)
    no, zero = jnp.zeros(passed.shape, bool), jnp.zeros(passed.shape)
    return Crossing(passed, no, no, zero, zero + jnp.asarray(offset, jnp.float32))


def step_of(s, rules, crossing=None):
    """The step of arrays `p0`, `p1`, `v0`, `v1`, `gate` [3, N, *B], `normal`, `flying`, `collided`, `nearest`."""
    before, after = (DroneState(RigidBody(s[p], s[v], s[p], s[p]), s[p]) for p, v in (("p0", "v0"), ("p1", "v1")))
    no = jnp.zeros(s["flying"].shape, bool)
    number = no.astype(jnp.int32)
    state = RaceState(before, number, number, ~s["flying"], no, number[0])
    view = GivenGate(state, s["gate"], s["normal"], jnp.ones_like(s["normal"]))
    return StepView(view, after, s["p0"], [crossing or crossing_of(no)], s["nearest"], s["collided"], rules)


def components_and_total(weights, s, rules, crossing, terminated):
    """What a step earns: its components and its reward."""
    reward = make_reward(weights)
    components = reward.components(step_of(s, rules, crossing))
    return components, reward.total(rules, components, crossing.passed, terminated)
