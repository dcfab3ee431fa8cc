"""What the terms of a reward look at: one step of all drones of a race, or of many."""

import copy
import functools
from collections.abc import Iterator, Sequence

from jaxtyping import Array, Bool, Float, Int

from cruise.dynamics import DroneState
from cruise.env.types import RaceState, Rules, gates_passed
from cruise.env.view import Sharing, View
from cruise.racing.course import Opening
from cruise.racing.gates import Crossing
from cruise.vector import norm


class StepView(Sharing):
    """A step, drone by drone. Components lead, then drones N, then races *B; SI units, `_w` is the world's frame.

    `before` is the race as it was, as an observation's terms see it, so that the target gate is the one of before the
    step; `after` are the drones as they are now, `action` is what they did, [A, N, *B] in [-1, 1]. `crossing` says what
    happened at the gates, `collided` whether a drone touched another, the ground or a frame, `nearest` how near it came
    to another one [m]. `further` are the crossings of the gates after the target, where one step can pass several.
    """

    def __init__(
        self,
        before: View,
        after: DroneState,
        action: Array,
        crossings: Sequence[Crossing],
        nearest: Float[Array, "N *B"],
        collided: Bool[Array, "N *B"],
        rules: Rules,
    ) -> None:
        """Nothing is computed yet."""
        super().__init__()
        self.before, self.after, self.action = before, after, action
        self.crossing, *self.further = crossings
        self.nearest, self.collided, self.rules = nearest, collided, rules

    @property
    def gates_passed(self) -> Int[Array, "N *B"] | None:
        """How many; None where a step can pass no more than one."""
        return gates_passed(self.crossing, tuple(self.further)) if self.further else None

    def by_gate(self) -> Iterator["StepView"]:
        """The step as seen from each gate that it can pass: they differ in `crossing`."""
        yield self
        for crossing in self.further:
            view = copy.copy(self)
            view.crossing, view.further, view._kept = crossing, [], {}
            yield view

    @property
    def state(self) -> RaceState:
        """The race before the step."""
        return self.before.state

    @property
    def airborne(self) -> Bool[Array, "N *B"]:
        """Still racing before the step."""
        return self.before.airborne

    @property
    def start_w(self) -> Float[Array, "3 N *B"]:
        """Position before [m]."""
        return self.before.position_w

    @property
    def end_w(self) -> Float[Array, "3 N *B"]:
        """Position after [m]."""
        return self.after.position_w

    @property
    def gate_after(self) -> Opening:
        """The gate that was the target before the step, where it stands after it."""
        gate = self.before.gate()
        return gate if gate.later is None else gate.later

    @property
    def velocity0_w(self) -> Float[Array, "3 N *B"]:
        """Velocity before [m/s]."""
        return self.before.velocity_w

    @property
    def velocity_w(self) -> Float[Array, "3 N *B"]:
        """Velocity after [m/s]."""
        return self.after.velocity_w

    @functools.cached_property
    def speed(self) -> Float[Array, "N *B"]:
        """After the step [m/s]."""
        return norm(self.velocity_w)
