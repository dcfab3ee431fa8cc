"""Terms: numbers of an observation, or parts of a reward, declared once.

The vector, its bounds, its layout, what a policy says of itself, what is logged and documented follow from them.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, NamedTuple

from cruise.errors import CruiseError

FRAMES = {
    "world": "x, y, z up",
    "gate": "forward, left, up of the target gate",
    "body": "forward, left, up of the drone",
}
LIMIT = 3.0  # to which a term is clipped where nothing else is said


@dataclass(frozen=True)
class Entry:
    """What some numbers of an observation mean: a quantity divided by its scale, then clipped to [low, high]."""

    name: str
    size: int
    quantity: str  # in words
    unit: str = ""  # of the quantity, before it is divided
    scale: float = 1.0
    frame: str = "world"  # one of FRAMES
    low: float = -LIMIT
    high: float = LIMIT


@dataclass(frozen=True)
class Term(Entry):
    """An entry and the function that gives its quantity, in its unit.

    `fn` takes a `cruise.env.view.View` of all drones and gives an array [size, N, *B], or [N, *B] where the size is 1.
    What a vehicle feels of itself is declared by its dynamics, and `fn` takes the state of the drones there.
    """

    fn: Callable[[Any], Any] = field(kw_only=True, repr=False)

    def __post_init__(self) -> None:
        """Raises CruiseError where the declaration makes no sense."""
        fault = _fault(self)
        if fault:
            raise CruiseError(f"term {self.name!r}: {fault}")

    @property
    def entry(self) -> Entry:
        """What is written down of it."""
        return Entry(**{one.name: getattr(self, one.name) for one in fields(Entry)})


class Setting(NamedTuple):
    """What the terms of an observation may depend on."""

    drones: int  # in the race
    gates: int  # of the track
    dynamics: Any  # `cruise.dynamics.types.Dynamics` of the vehicle


Terms = tuple[Term, ...] | Callable[[Setting], tuple[Term, ...]]


@dataclass(frozen=True)
class Observation:
    """What a drone sees: terms one after the other, or a function of a setting that gives them."""

    name: str
    terms: Terms
    action_frame: Literal["vehicle", "gate"] = "vehicle"
    """In which a policy on it speaks: the vehicle's own, or its target gate's where an action is a world vector."""
    about: str = ""
    """What it is for, in a sentence."""

    def terms_for(self, setting: Setting) -> tuple[Term, ...]:
        """The terms in a setting. Raises CruiseError where they are no terms, or two have one name."""
        terms = self.terms(setting) if callable(self.terms) else self.terms
        if not (isinstance(terms, tuple) and terms and all(isinstance(term, Term) for term in terms)):
            raise CruiseError(f"observation {self.name!r}: expected a tuple of terms, got {_short(terms)}")
        names = [term.name for term in terms]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise CruiseError(f"observation {self.name!r}: two terms are called {twice!r}")
        return terms

    def with_terms(self, name: str, *terms: Term, about: str = "") -> "Observation":
        """Another observation: this one, then more terms."""
        return Observation(name, lambda setting: (*self.terms_for(setting), *terms), self.action_frame, about)


PHASES = {
    "flight": "at every step but those that pass a gate",
    "passing": "at the steps that pass a gate",
    "interaction": "at every step",
}  # the step that ends an episode by a crash has a reward of its own


@dataclass(frozen=True)
class RewardTerm:
    """A part of the reward: `weight` times what `fn` gives.

    `fn` takes a `cruise.env.step_view.StepView` of all drones and gives an array [N, *B]. The weight is a number, or a
    function of `cruise.env.types.Rules` where the stage decides it.
    """

    name: str
    phase: str  # one of PHASES
    weight: float | Callable[[Any], Any]
    fn: Callable[[Any], Any] = field(repr=False)
    meaning: str = ""  # in words, or as an equation

    def __post_init__(self) -> None:
        """Raises CruiseError where the declaration makes no sense."""
        fault = _reward_fault(self)
        if fault:
            raise CruiseError(f"reward term {self.name!r}: {fault}")


def _reward_fault(term: RewardTerm) -> str | None:
    if not isinstance(term.name, str) or not term.name.isidentifier():
        return "a name is one word of letters, digits and underscores"
    if term.phase not in PHASES:
        return f"unknown phase {term.phase!r}; there are {', '.join(PHASES)}"
    if not callable(term.weight) and not (_is_number(term.weight) and math.isfinite(term.weight)):
        return f"weight must be a finite number, or a function of the rules, not {term.weight!r}"
    return None if callable(term.fn) else f"fn must be a function of the step, not {term.fn!r}"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _fault(term: Term) -> str | None:
    if not isinstance(term.name, str) or not term.name.isidentifier():
        return "a name is one word of letters, digits and underscores"
    if isinstance(term.size, bool) or not isinstance(term.size, int) or term.size < 1:
        return f"size is a number of numbers, 1 or more, not {term.size!r}"
    if not (_is_number(term.scale) and math.isfinite(term.scale) and term.scale > 0):
        return f"scale must be above 0 and finite, not {term.scale!r}"
    if not (_is_number(term.low) and _is_number(term.high) and term.low < term.high):
        return f"low must be below high, not {term.low!r} and {term.high!r}"
    if term.frame not in FRAMES:
        return f"unknown frame {term.frame!r}; there are {', '.join(FRAMES)}"
    return None if callable(term.fn) else f"fn must be a function of the view, not {term.fn!r}"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def difference(stored: tuple[Entry, ...], here: tuple[Entry, ...]) -> str | None:
    """The first thing that two layouts differ in, in words; None where the same numbers mean the same."""
    for number, (a, b) in enumerate(zip(stored, here, strict=False), start=1):
        theirs, ours = ({k: v for k, v in asdict(one).items() if k not in ("quantity", "fn")} for one in (a, b))
        for key, value in theirs.items():
            if value != ours[key]:
                what = f"its term {number}" if key == "name" else f"{key} of its term {a.name!r}"
                return f"{what} was {value!r} and is {ours[key]!r} here"
    if len(stored) != len(here):
        return f"it had {len(stored)} terms and has {len(here)} here"
    return None
