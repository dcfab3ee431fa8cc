"""Observations by name, the vector that their terms make, and its layout."""

import functools
from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from cruise.dynamics import make_dynamics
from cruise.dynamics.types import Dynamics
from cruise.env.observation_body import BODY, BODY_FAR, BODY_NEAR, BODY_PLACED
from cruise.env.observation_extended import EXTENDED
from cruise.env.observation_paper import PAPER
from cruise.env.observation_racing import RACING, RACING_FAR, RACING_NEAR
from cruise.env.types import RaceState
from cruise.env.view import View, out_of_gate_frame
from cruise.errors import CruiseError
from cruise.presets import VEHICLES
from cruise.racing.course import Course
from cruise.terms import Entry, Observation, Setting, Term, difference

OWN = (EXTENDED, PAPER, BODY, BODY_NEAR, BODY_PLACED, BODY_FAR, RACING, RACING_NEAR, RACING_FAR)
OBSERVATIONS = {one.name: one for one in OWN}  # and those that users add


def add_observation(observation: Observation) -> None:
    """Make an observation known by its name. Raises CruiseError where it is one of CRUISE's own."""
    if not isinstance(observation, Observation):
        raise CruiseError(f"expected an Observation, got {type(observation).__name__}")
    if observation.name in [one.name for one in OWN]:
        raise CruiseError(f"observation {observation.name!r} is CRUISE's own: give yours another name")
    OBSERVATIONS[observation.name] = observation


def find_observation(name: str) -> Observation:
    """The observation of a name. Raises CruiseError where none is known."""
    if name not in OBSERVATIONS:
        raise CruiseError(
            f"unknown observation {name!r}; there are {', '.join(OBSERVATIONS)}; "
            "give the file that declares another (--terms FILE.py, or cruise.load_terms)"
        )
    return OBSERVATIONS[name]


def observation_layout(name: str, setting: Setting) -> tuple[Entry, ...]:
    """What the numbers of an observation are, in their order. Raises CruiseError where it is not known."""
    return tuple(term.entry for term in find_observation(name).terms_for(setting))


def for_any_field(name: str) -> bool:
    """Whether an observation is known and has the same numbers whatever the number of drones."""
    return name in OBSERVATIONS and _for_any_field(OBSERVATIONS[name])


@functools.lru_cache(maxsize=64)
def _for_any_field(observation: Observation) -> bool:
    dynamics = make_dynamics(VEHICLES["paper"])
    few, many = (observation.terms_for(Setting(drones, 3, dynamics)) for drones in (2, 3))
    return [term.entry for term in few] == [term.entry for term in many]


def alike(name: str) -> frozenset[str]:
    """Observations whose numbers mean the same as those of `name`, though some may fade with distance."""
    setting = Setting(2, 3, make_dynamics(VEHICLES["paper"]))
    wanted = observation_layout(name, setting)
    return frozenset(other for other in OBSERVATIONS if not difference(wanted, observation_layout(other, setting)))


def check_observation(who: str, name: str) -> None:
    """Raises CruiseError where the observation that somebody flies by is not known."""
    if name not in OBSERVATIONS:
        raise CruiseError(
            f"{who} sees by the observation {name!r}, which is not known here: give the file that declares it "
            "(--terms FILE.py, or cruise.load_terms)"
        )


def observation_vector(
    observation: Observation, course: Course, dynamics: Dynamics, state: RaceState
) -> Float[Array, "O N *B"]:
    """The terms of an observation, one after the other: each over its scale, clipped to its bounds."""
    view = View(course, dynamics, state)
    terms = observation.terms_for(Setting(view.num_drones, view.num_gates, dynamics))
    return jnp.concatenate([_numbers(observation, term, view) for term in terms])


def _numbers(observation: Observation, term: Term, view: View) -> Float[Array, "K N *B"]:
    value = jnp.asarray(term.fn(view))
    if term.size == 1 and value.shape == view.airborne.shape:
        value = value[None]
    expected = (term.size, *view.airborne.shape)
    if value.shape != expected:
        raise CruiseError(
            f"term {term.name!r} of observation {observation.name!r} gives an array {list(value.shape)}, "
            f"expected {list(expected)}: its size, drones, races"
        )
    return jnp.clip(value if term.scale == 1 else value / term.scale, term.low, term.high)


Decode = Callable[[Course, Array, Array], Array]


def action_decoder(observation: Observation, dynamics: Dynamics) -> Decode:
    """How what a policy on an observation says becomes the vehicle's action.

    Only directions in the world can be given in a gate's frame; thrust and body rates are the body's own.
    """
    turned = observation.action_frame == "gate" and dynamics.action_frame == "world"
    return out_of_gate_frame if turned else _as_it_is


def _as_it_is(course: Course, next_gate: Int[Array, "*B"], action: Float[Array, "A *B"]) -> Float[Array, "A *B"]:
    del course, next_gate
    return action
