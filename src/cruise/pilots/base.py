"""The one interface of everything that can fly a race."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

from jaxtyping import Array, Float

from cruise.config import Track, Vehicle
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.errors import CruiseError

Memory = Any  # a pytree of arrays that the pilot carries from step to step; () when it needs none


@runtime_checkable
class Pilot(Protocol):
    """Flies one drone or several of a race; pure functions that JAX can trace.

    A pilot is a pytree, so that one compiled rollout serves every set of parameters. `drones` are the static indices of
    the drones it flies; all arrays it meets are component-first and batch-last.
    """

    @property
    def name(self) -> str:
        """What result tables call it."""
        ...

    @property
    def agility(self) -> float:
        """Scale of its actions, alpha [m/s^2 in the paper's vehicle]."""
        ...

    @property
    def vehicle(self) -> str | Vehicle:
        """What it was made for: the name of a preset, or a vehicle of one's own."""
        ...

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """Memory at the start of a race. Raises CruiseError where the pilot cannot fly in this environment."""
        ...

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """New memory and an action in [-1, 1] for each of the `n = len(drones)` drones it flies."""
        ...


@runtime_checkable
class Versatile(Protocol):
    """A pilot that can fly any vehicle."""

    def for_vehicle(self, vehicle: Vehicle) -> Pilot:
        """The same pilot in another vehicle."""
        ...


class Crew(NamedTuple):
    """A pilot and the drones it flies."""

    pilot: Pilot
    drones: tuple[int, ...]


def crews(team: Sequence[Pilot], vehicles: Sequence[Vehicle] | None = None) -> tuple[Crew, ...]:
    """The team, one pilot per drone, with equal pilots of equal vehicles put together so that they act in one batch."""
    drones: dict[tuple[int, Vehicle | None], list[int]] = {}
    for drone, pilot in enumerate(team):
        drones.setdefault((id(pilot), vehicles[drone] if vehicles else None), []).append(drone)
    return tuple(Crew(team[flown[0]], tuple(flown)) for flown in drones.values())


def must_know(track: Track, pilot: str) -> None:
    """Raises CruiseError where every race has gates of its own: this pilot is told where they are before the start."""
    if track.variants:
        raise CruiseError(f"pilot {pilot!r} must know the track, and {track.name!r} is another one in every race")
