"""What can be chosen: how the planner computes, and how a drone is to fly."""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from jaxtyping import Array

Limit = Literal["ball", "box"]


@dataclass(frozen=True)
class Weights:
    """What things cost in a best response, in metres of progress."""

    corridor: float = 25.0  # per metre and step outside the corridor
    collision: float = 8.0  # per metre and step too near to an opponent
    acceleration: float = 2e-3  # half of it times the squared acceleration [s^4/m]
    centre: float = 2e-3  # half of it times the squared distance from the centre line's point [1/m]


@dataclass(frozen=True)
class Algorithm:
    """How the planner computes. Static: a change compiles anew."""

    horizon: int = 20  # K, steps of a plan
    dt: float = 0.15  # between them [s]
    period: float = 0.1  # from one plan to the next [s]
    rounds: int = 3  # of best responses
    iterations: int = 30  # of the solver, per best response
    decay: float = 0.5  # the sensitivity counts by this factor less in every further round
    limit: Limit = "ball"  # of the acceleration: of its norm, or of every axis of the world by itself
    weights: Weights = field(default_factory=Weights)


class Style(NamedTuple):
    """How a drone is to fly. Traced: a change compiles nothing. Every entry broadcasts over [N, *B]."""

    speed: Array | float  # at most [m/s]
    acceleration: Array | float  # at most [m/s^2]
    margin: Array | float = 0.35  # kept from the edge of the corridor and of openings [m]
    separation: Array | float = 0.8  # between two drones [m]
    sensitivity: Array | float = 0.5  # alpha, how much the others' losses count in the first round
    lead: Array | float = 0.3  # the vehicle is made to reach the plan's velocity of so much later [s]
