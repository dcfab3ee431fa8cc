"""What counts of a step, in the order in which it happened: nothing does after the end of a drone's race.

A drone that crashes or finishes within a step leaves the air at the step's end: until then it obstructs others.
"""

import functools
import operator
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from cruise.env.types import Collisions, Rules
from cruise.racing.contacts import outside_box
from cruise.racing.course import Course
from cruise.racing.events import COLLISION_KINDS
from cruise.racing.gates import Crossing
from cruise.vector import once


class Happened(NamedTuple):
    """What counts of a step."""

    crossings: list[Crossing]  # of the target gate and, where the step reached so far, of those after it
    solid: Bool[Array, "N *B"]  # any collision of those that do not end a race in every stage
    terminated: Bool[Array, "N *B"]  # the race ended in this step by a crash
    finished: Bool[Array, "N *B"]  # the race ended in this step by its last gate


class Flown(NamedTuple):
    """One step of all drones."""

    start_w: Float[Array, "3 N *B"]
    end_w: Float[Array, "3 N *B"]
    airborne: Bool[Array, "N *B"]
    gates_passed: Int[Array, "N *B"]  # before it


def in_order(
    course: Course,
    flown: Flown,
    crossings: list[Crossing],
    touched: list[Array],
    met: dict[str, Array],
    collisions: Collisions,
    rules: Rules,
) -> Happened:
    """Crossings count unless a collision that ends the race comes before; a crash counts unless the finish does.

    Args:
        course: where.
        flown: the step.
        crossings: of the target gate and of those after it, as if nothing else were met.
        touched: for every crossing, whether another drone was touched before it.
        met: by kind of solid, the fraction of the step at which it was met.
        collisions: of the step, whenever in it.
        rules: which collisions end a race, and how many gates it has.
    """
    solid = once(_any(collisions, lost=False))
    lost = _any(collisions, lost=True)
    counted = []
    finished = jnp.zeros(solid.shape, bool)
    for number, (crossing, drone) in enumerate(zip(crossings, touched, strict=True), start=1):
        at = flown.start_w + crossing.fraction * (flown.end_w - flown.start_w)
        struck = drone | (at[2] <= 0.0) | (crossing.frame_fraction < crossing.fraction)
        for fraction in met.values():
            struck |= fraction < crossing.fraction
        crashed = once(outside_box(course, at) | (struck & rules.terminal_collisions))
        counts = flown.airborne & ~crashed & ~finished
        passed = once(crossing.passed & counts)
        counted.append(crossing._replace(passed=passed, missed=crossing.missed & counts))
        last = (rules.gates_to_finish > 0) & (flown.gates_passed + number >= rules.gates_to_finish)
        finished |= passed & last
    return Happened(counted, solid, once((lost | (solid & rules.terminal_collisions)) & ~finished), finished)


def _any(collisions: Collisions, lost: bool) -> Bool[Array, "N *B"]:
    """Any collision of those that end a race in every stage, or of the others."""
    return functools.reduce(operator.or_, [getattr(collisions, k.hit) for k in COLLISION_KINDS if k.ends == lost])
