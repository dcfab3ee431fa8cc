"""How the terms of a reward come together: their sum, its clip, and the end of an episode."""

import functools
import operator
from collections.abc import Iterable
from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from cruise.config import RewardWeights
from cruise.env.reward import reward_terms
from cruise.env.step_view import StepView
from cruise.env.types import Rules, StepOutcome
from cruise.errors import CruiseError
from cruise.terms import RewardTerm

ADDED = ("terminal", "clip")  # what is no term: the price of a crash, and what the clip takes or gives


@dataclass(frozen=True)
class Reward:
    """A tuple of weighted terms, and the bounds of their sum."""

    terms: tuple[RewardTerm, ...]
    clip: float = 1.0  # each step's sum is clipped to [-clip, clip]
    highest: float = 1.0  # and to this from above in the step that passes a gate, times the gates
    terminal: float = -1.0  # of the step that ends an episode by a crash, outside the clip

    def __post_init__(self) -> None:
        """Raises CruiseError where two terms have one name, or one has a name that is taken."""
        names = [term.name for term in self.terms]
        for name in names:
            if names.count(name) > 1 or name in ADDED:
                raise CruiseError(f"reward term {name!r}: there is another of this name: choose one of your own")

    @property
    def names(self) -> tuple[str, ...]:
        """Of all that the reward is the sum of."""
        return (*(term.name for term in self.terms), *ADDED)

    def of_phase(self, phase: str) -> list[str]:
        """Names of the terms of a phase."""
        return [term.name for term in self.terms if term.phase == phase]

    def components(self, step: StepView) -> dict[str, Float[Array, "N *B"]]:
        """Weighted terms before the clip; those of the passing of a gate are the sum over the gates that are passed."""
        return {term.name: _weighted(term, step) for term in self.terms}

    def total(
        self,
        rules: Rules,
        components: dict[str, Array],
        passed: Bool[Array, "N *B"],
        terminated: Bool[Array, "N *B"],
        gates: Int[Array, "N *B"] | None = None,
    ) -> Float[Array, "N *B"]:
        """Sum and clip; a passed gate replaces the terms of flight, the end of an episode replaces everything.

        `gates` is how many were passed, where a step can pass several: each lifts the clip.
        """

        def summed(phase: str) -> Array:
            return _sum((components[name] for name in self.of_phase(phase)), passed.shape)

        reward = jnp.where(passed, summed("passing"), summed("flight")) + summed("interaction")
        highest = jnp.where(passed, self.highest if gates is None else self.highest * gates, self.clip)
        return jnp.where(terminated, rules.crash_share * self.terminal, jnp.clip(reward, -self.clip, highest))

    def counted(self, outcome: StepOutcome) -> dict[str, Float[Array, "N *B"]]:
        """The terms as they counted, with the price of a crash and what the clip took: their sum is the reward."""
        ended, passed = outcome.terminated, outcome.crossing.passed
        counts = {"flight": ~(ended | passed), "passing": passed & ~ended, "interaction": ~ended}
        terms = {term.name: jnp.where(counts[term.phase], outcome.components[term.name], 0.0) for term in self.terms}
        left = outcome.reward - _sum(terms.values(), ended.shape)
        return terms | {"terminal": jnp.where(ended, left, 0.0), "clip": jnp.where(ended, 0.0, left)}


REWARD_TERMS: dict[str, RewardTerm] = {}  # of users, by name


def add_reward_term(term: RewardTerm) -> None:
    """Make a term known by its name. Raises CruiseError where the reward has one of this name already."""
    make_reward(RewardWeights(), (term,))
    REWARD_TERMS[term.name] = term


def find_reward_terms(names: Iterable[str]) -> tuple[RewardTerm, ...]:
    """The terms of these names. Raises CruiseError where one is not known."""
    for name in names:
        if name not in REWARD_TERMS:
            known = f"; known are {', '.join(REWARD_TERMS)}" if REWARD_TERMS else ""
            raise CruiseError(
                f"unknown reward term {name!r}{known}: give the file that declares it (--terms FILE.py, or "
                "cruise.load_terms)"
            )
    return tuple(REWARD_TERMS[name] for name in names)


def make_reward(weights: RewardWeights, more: tuple[RewardTerm, ...] = ()) -> Reward:
    """The reward with these weights, and more terms."""
    highest = max(weights.clip, weights.gate_bonus)
    return Reward((*reward_terms(weights), *more), weights.clip, highest, weights.terminal)


def _weighted(term: RewardTerm, step: StepView) -> Float[Array, "N *B"]:
    if not callable(term.weight) and term.weight == 0:
        return jnp.zeros(step.airborne.shape)
    weight = term.weight(step.rules) if callable(term.weight) else term.weight
    if term.phase != "passing":
        return weight * _value(term, step)
    paid = (jnp.where(gate.crossing.passed, weight * _value(term, gate), 0.0) for gate in step.by_gate())
    return functools.reduce(operator.add, paid)


def _value(term: RewardTerm, step: StepView) -> Array:
    value, shape = jnp.asarray(term.fn(step)), step.airborne.shape
    if value.shape != shape:
        raise CruiseError(
            f"reward term {term.name!r} gives an array {list(value.shape)}, expected {list(shape)}: drones, races"
        )
    return value


def _sum(parts: Iterable[Array], shape: tuple[int, ...]) -> Array:
    listed = list(parts)
    return functools.reduce(operator.add, listed) if listed else jnp.zeros(shape)
