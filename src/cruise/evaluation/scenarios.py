"""Situations of a race with known answers, as data."""

from dataclasses import dataclass
from typing import NamedTuple


class Place(NamedTuple):
    """Where a drone waits: before which gate after the pilot's first, how far before it and left of its middle [m]."""

    gate: int
    back: float
    left: float = 0.0


@dataclass(frozen=True)
class Opponent:
    """Another drone of a scenario."""

    place: Place
    pace: float = 0.0  # its speed as a share of the pilot's own when alone; 0: the pilot itself flies it
    lane: float = 0.0  # left of the middle of every gate, as a share of half its width
    falls_after: float = float("inf")  # out of the air, near the gate after so many


@dataclass(frozen=True)
class Scenario:
    """What is flown, and what should come of it: always that the pilot finishes and no contact is its fault."""

    name: str
    about: str
    place: Place  # of the pilot
    opponents: tuple[Opponent, ...]
    first: bool = True  # the pilot should be first in the end

    @property
    def drones(self) -> int:
        """The pilot and its opponents."""
        return 1 + len(self.opponents)

    @property
    def against_itself(self) -> bool:
        """Whether the pilot flies the first opponent too."""
        return self.opponents[0].pace == 0


BEHIND, NEXT = 3.0, 1  # a row back [m]; the gate after the first
SCENARIOS = (
    Scenario("pass", "catch and pass a slower drone", Place(0, 2.0), (Opponent(Place(NEXT, 2.0), pace=0.6),)),
    Scenario("lead", "hold a lead against an equal", Place(0, 1.5), (Opponent(Place(0, BEHIND)),)),
    Scenario(
        "side by side",
        "go through one gate beside an equal",
        Place(0, 2.0, 0.6),
        (Opponent(Place(0, 2.0, -0.6)),),
        first=False,
    ),
    Scenario(
        "wall",
        "pass two slower drones that fly abreast",
        Place(0, 2.0),
        tuple(Opponent(Place(NEXT, 2.0, 0.6 * side), pace=0.5, lane=0.5 * side) for side in (1, -1)),
    ),
    Scenario(
        "crash ahead",
        "come through where the drone ahead falls out of the air",
        Place(0, BEHIND),
        (Opponent(Place(0, 1.5), pace=0.9, falls_after=2),),
    ),
    Scenario(
        "from last",
        "become first of four from the last place",
        Place(0, 2.0),
        (
            Opponent(Place(NEXT, 1.5), pace=0.75),
            Opponent(Place(NEXT, BEHIND, 0.6), pace=0.7, lane=0.3),
            Opponent(Place(NEXT, BEHIND, -0.6), pace=0.65, lane=-0.3),
        ),
    ),
)
MOST_DRONES = max(scenario.drones for scenario in SCENARIOS)
