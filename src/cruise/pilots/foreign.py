"""Pilots in plain Python: any function or class, asked between the steps of the compiled program."""

import functools
import inspect
import math
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cruise.config import ObservationKind, Vehicle
from cruise.env.observation import OBSERVATIONS
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.errors import CruiseError, one_line
from cruise.pilots.base import Memory, Pilot
from cruise.vehicles import VEHICLES, find_vehicle

Style = Literal["function", "object", "batch"]

DEFAULT_BUDGET = 10.0  # per action: a pilot that hangs is found, one on a busy machine is not disturbed [s]
HERE = str(Path(__file__).parent)
RULES = "act(view) gives its action, or act_batch(view) those of many drones"


@dataclass(frozen=True, eq=False)
class ForeignPilot:
    """A pilot in plain Python; see `cruise.pilots.view.View` for what it sees.

    `function`: one function, asked for each drone. `object`: one object per drone and race. `batch`: one object that is
    asked for all its drones in all races at once.
    """

    make: Callable[[], Callable[..., Any]]  # what is asked for actions, made anew for each object
    style: Style
    name: str
    agility: float
    vehicle: str | Vehicle
    observation: ObservationKind | None  # what it sees beside the state; it then speaks in the same frame
    budget: float  # time for an action of one drone [s]

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """Raises CruiseError: `cruise.pilots.python_pilot` flies it, a compiled program cannot."""
        raise CruiseError(f"pilot {self.name!r} is plain Python: it cannot fly inside a compiled program")

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """As `init`."""
        raise CruiseError(f"pilot {self.name!r} is plain Python: it cannot fly inside a compiled program")


class Commanded(eqx.Module):
    """Stands in the compiled program for a pilot outside of it: its memory is its next action."""

    observation: ObservationKind | None = eqx.field(static=True, default=None)
    name: str = eqx.field(static=True, default="commanded")
    agility: float = eqx.field(static=True, default=1.0)
    vehicle: str | Vehicle = eqx.field(static=True, default="paper")

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """No command yet."""
        return jnp.zeros((env.dynamics.action_size, len(drones), *state.step.shape), jnp.float32)

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """What it was told, turned into the world's frame if it was told in another."""
        del key
        action = memory
        if self.observation is not None:
            action = env.decode_as[self.observation](state, action, drones)
        return memory, jnp.clip(action, -1.0, 1.0)


def wrap(thing: object, name: str | None = None, budget: float = DEFAULT_BUDGET) -> Pilot:
    """Make a pilot of a Python function, class or object.

    Args:
        thing: a function of a view; a class whose objects have `act(view)`, `act_batch(view)` or are callable; such an
            object; or a `Pilot` (or class of one) in JAX, which is given back.
        name: what result tables call it, if its attribute `name` does not say so.
        budget: time for an action of one drone [s].

    Raises:
        CruiseError: it is none of these, or an attribute of it makes no sense.
    """
    is_class = inspect.isclass(thing)
    if not is_class and isinstance(thing, Pilot):
        return thing
    name = (
        _text(getattr(thing, "name", None)) or name or _text(getattr(thing, "__name__", None)) or type(thing).__name__
    )
    if isinstance(thing, type) and hasattr(thing, "init"):
        made = construct(thing, name)
        if isinstance(made, Pilot):
            return made
    if not (math.isfinite(budget) and budget > 0):
        raise CruiseError(f"the time budget of a pilot must be above 0, got {budget:g} s")
    style, make = _asked(thing, name)
    observation = getattr(thing, "observation", None)
    if observation not in (None, *OBSERVATIONS):
        kinds = ", ".join(OBSERVATIONS)
        raise CruiseError(f"pilot {name!r}: unknown observation {observation!r}; there are {kinds}, or None")
    vehicle = getattr(thing, "vehicle", "paper")
    if not isinstance(vehicle, Vehicle) and vehicle not in VEHICLES:
        raise CruiseError(f"pilot {name!r}: unknown vehicle {vehicle!r}; vehicles: {', '.join(VEHICLES)}")
    agility = _agility(thing, name, find_vehicle(vehicle).agility)
    return ForeignPilot(make, style, name, agility, vehicle, observation, budget)


def _asked(thing: object, name: str) -> tuple[Style, Callable[[], Callable[..., Any]]]:
    """How it is asked, and what makes the callable that is."""
    if isinstance(thing, type):
        method = next((method for method in METHODS if _has_method(thing, method)), None)
        if method is None:
            raise CruiseError(f"pilot {name!r}: class {thing.__name__} has no method act: {RULES}")
        return METHODS[method], lambda: getattr(construct(thing, name), method)
    for method in ("act_batch", "act"):
        if callable(bound := getattr(thing, method, None)):
            return "batch" if method == "act_batch" else "function", functools.partial(_itself, bound)
    if callable(thing):
        return "function", functools.partial(_itself, thing)
    raise CruiseError(f"pilot {name!r} is of type {type(thing).__name__}: expected a function or a class; {RULES}")


def _itself(function: Callable[..., Any]) -> Callable[..., Any]:
    return function


METHODS: dict[str, Style] = {"act_batch": "batch", "act": "object", "__call__": "object"}


def _has_method(kind: type, method: str) -> bool:
    """Its own or inherited; a class itself is callable, which says nothing of its objects."""
    return any(callable(vars(base).get(method)) for base in kind.__mro__)


def _agility(thing: object, name: str, usual: float) -> float:
    agility = getattr(thing, "agility", usual)
    if isinstance(agility, bool) or not isinstance(agility, int | float | np.number) or not 0 < agility < math.inf:
        raise CruiseError(f"pilot {name!r}: agility must be a number above 0, got {agility!r}")
    return float(agility)


def _text(value: object) -> str | None:
    return value if isinstance(value, str) and value else None


def construct(thing: Callable[[], Any], name: str) -> Any:
    """An object of a pilot's class. Raises CruiseError where its constructor fails."""
    try:
        return thing()
    except (KeyboardInterrupt, CruiseError):
        raise
    except BaseException as error:  # sys.exit() among them
        raise CruiseError(
            f"pilot {name!r} could not be made: {explain(error)}; its class takes no arguments"
        ) from error


def explain(error: BaseException) -> str:
    """An exception and where it was raised, in one line."""
    frames = traceback.extract_tb(error.__traceback__)
    theirs = [frame for frame in frames if not frame.filename.startswith((HERE, "<frozen"))]
    own = [frame for frame in theirs if "site-packages" not in frame.filename] or theirs
    at = f" ({own[-1].filename}, line {own[-1].lineno})" if own else ""
    message = one_line(error)
    return f"{type(error).__name__}{': ' * bool(message)}{message}{at}"
