"""What can happen to a drone. Declared here and nowhere else; a log stores kinds by name, so their order is free."""

from enum import IntEnum
from typing import Literal

Role = Literal["gate", "warning", "crash", "finish"]  # in what colour it is shown
COLLISION = "collision_"


class EventKind(IntEnum):
    """Kinds of event; their numbers are of this program alone, their names are stored."""

    meaning: str  # for docs
    said: str  # of a drone, in the present tense
    fate: str  # how a race ended by it, in the past tense; "" where it ends none
    role: Role
    ends: bool  # of collisions: ends a race in every stage of training too

    def __new__(cls, meaning: str, said: str, fate: str, role: Role, ends: bool = False) -> "EventKind":
        """Numbered as they come."""
        kind = int.__new__(cls, len(cls.__members__))
        kind._value_ = len(cls.__members__)
        kind.meaning, kind.said, kind.fate, kind.role, kind.ends = meaning, said, fate, role, ends
        return kind

    CROSSING = ("its target gate was passed", "passes a gate", "", "gate")
    MISSED_GATE = ("flew by its target gate, beside opening and frame", "misses a gate", "", "warning")
    COLLISION_DRONE = (
        "came within the collision distance of another drone",
        "hits a drone",
        "hit a drone",
        "crash",
    )
    COLLISION_GROUND = ("touched the ground", "hits the ground", "hit the ground", "crash")
    COLLISION_GATE_FRAME = ("struck the border of a gate", "hits a gate", "hit a gate", "crash")
    COLLISION_BOUNDS = ("left the track", "leaves the track", "left the track", "crash", True)
    COLLISION_FLIP = ("rolled or pitched past 90 degrees", "flips over", "flipped over", "crash", True)
    COLLISION_POLE = ("struck a pole", "hits a pole", "hit a pole", "crash")
    COLLISION_WALL = ("struck a wall", "hits a wall", "hit a wall", "crash")
    FINISH = ("passed the last gate of the race", "finishes", "", "finish")

    @property
    def stored(self) -> str:
        """The name under which logs, metrics and pages have it."""
        return self.name.lower()

    @property
    def hit(self) -> str:
        """Of a collision: with what, as `Collisions` names it."""
        return self.stored.removeprefix(COLLISION)


EVENT_KINDS = tuple(kind.stored for kind in EventKind)
COLLISION_KINDS = tuple(kind for kind in EventKind if kind.stored.startswith(COLLISION))
COLLISIONS = tuple(kind.stored for kind in COLLISION_KINDS)
