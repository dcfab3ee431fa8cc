"""State and outcome of a race, or of many: components lead, then drones, then races."""

import functools
import operator
from collections import namedtuple
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from jaxtyping import Array, Bool, Float, Int

from cruise.config import Stage
from cruise.dynamics.types import DroneState
from cruise.env.sensing import Opponents
from cruise.env.surroundings import Surroundings
from cruise.racing.events import COLLISION_KINDS
from cruise.racing.gates import Crossing


class Rules(NamedTuple):
    """Theta_k and the rules of a race as traced values, so that a new stage recompiles nothing.

    Each is a scalar, or broadcasts over [N, *B] where drones or races differ.
    """

    v_min: Float[Array, "..."] | float  # [m/s]
    agility: Float[Array, "..."] | float  # [m/s^2] in the paper's vehicle
    w_coll: Float[Array, "..."] | float
    w_over: Float[Array, "..."] | float
    crash_share: Float[Array, "..."] | float  # of `RewardWeights.terminal`
    gate_tolerance: Float[Array, ""] | float  # [m]
    collision_distance: Float[Array, "..."] | float  # [m]
    terminal_collisions: Bool[Array, ""] | bool
    gates_to_finish: Int[Array, ""] | int  # gates passed to finish the race; 0: no finish


class RaceState(NamedTuple):
    """Everything that a step of a race depends on."""

    drones: DroneState  # [... N *B]
    next_gate: Int[Array, "N *B"]
    gates_passed: Int[Array, "N *B"]
    out: Bool[Array, "N *B"]  # crashed, or never took part
    finished: Bool[Array, "N *B"]
    step: Int[Array, "*B"]  # control steps since the start
    surroundings: Surroundings = Surroundings()
    opponents: Opponents | None = None  # as every drone perceives them; None: as they are

    @property
    def airborne(self) -> Bool[Array, "N *B"]:
        """Still racing. Who is not has left the air and obstructs nobody."""
        return ~(self.out | self.finished)


# What a drone hit in a step, one flag [N *B] for each kind of collision that `cruise.racing.events` declares, without
# its prefix: `collisions.ground` is an event `collision_ground`.
if TYPE_CHECKING:
    Collisions: TypeAlias = Any
else:
    Collisions = namedtuple("Collisions", [kind.hit for kind in COLLISION_KINDS])


class StepOutcome(NamedTuple):
    """What a step did, drone by drone. The time limit is the caller's: see `cruise.rollout`."""

    reward: Float[Array, "N *B"]
    components: dict[str, Float[Array, "N *B"]]  # weighted terms of the reward, before the clip
    terminated: Bool[Array, "N *B"]  # this drone's race ended in this step by a crash
    crossing: Crossing  # of the target gate
    collisions: Collisions
    further: tuple[Crossing, ...] = ()  # of the gates after the target, where two stand within a step of each other

    @property
    def gates_passed(self) -> Int[Array, "N *B"]:
        """How many gates were passed in the step."""
        return gates_passed(self.crossing, self.further)


def gates_passed(crossing: Crossing, further: tuple[Crossing, ...]) -> Int[Array, "N *B"]:
    """How many gates a step passed."""
    return functools.reduce(operator.add, [one.passed for one in further], crossing.passed.astype(int))


def stage_rules(stage: Stage, collision_distance: float) -> Rules:
    """The rules under which a stage of the curriculum trains; races there have no finish."""
    return Rules(
        v_min=stage.v_min,
        agility=stage.agility,
        w_coll=stage.w_coll if stage.collision_penalty else 0.0,
        w_over=stage.w_over,
        crash_share=stage.crash_share,
        gate_tolerance=stage.gate_tolerance,
        collision_distance=collision_distance,
        terminal_collisions=stage.terminal_collisions,
        gates_to_finish=0,
    )


def race_rules(
    agility: Float[Array, "..."] | float, collision_distance: Float[Array, "..."] | float, gates_to_finish: int
) -> Rules:
    """The rules of a real race: true openings, every collision final. Rewards are not meant to be read."""
    return Rules(
        v_min=0.0,
        agility=agility,
        w_coll=0.0,
        w_over=0.0,
        crash_share=1.0,
        gate_tolerance=0.0,
        collision_distance=collision_distance,
        terminal_collisions=True,
        gates_to_finish=gates_to_finish,
    )
