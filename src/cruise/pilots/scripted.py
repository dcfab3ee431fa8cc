"""Pilots written by hand for any vehicle: references to race against and to test with."""

from dataclasses import replace
from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Vehicle
from cruise.dynamics import Reference
from cruise.env.race_env import RaceEnv
from cruise.env.sensing import Opponents
from cruise.env.types import RaceState
from cruise.pilots.base import Memory, Pilot
from cruise.racing.course import Course, pick
from cruise.racing.field import over_opponents, rows
from cruise.vector import norm
from cruise.vehicles import find_vehicle, reference_to

EPSILON = 1e-6
Scalars = Float[Array, "N *B"] | float

P = TypeVar("P", bound="Hover | Chaser")


def _aboard(pilot: P, vehicle: Vehicle, **fields: Any) -> P:
    """The pilot in another vehicle, `fields` being what suits that one; it knows the paper's by heart."""
    if vehicle == find_vehicle(pilot.vehicle):
        return pilot
    return replace(pilot, vehicle=reference_to(vehicle), agility=vehicle.agility, **fields)


class Hover(eqx.Module):
    """Stays where it started."""

    name: str = eqx.field(static=True, default="hover")
    agility: float = eqx.field(static=True, default=7.5)
    vehicle: str | Vehicle = eqx.field(static=True, default="paper")
    velocity_gain: float = eqx.field(static=True, default=3.75)  # [1/s]
    position_gain: float = eqx.field(static=True, default=0.3)  # [1/s]

    def for_vehicle(self, vehicle: Vehicle) -> "Hover":
        """The same pilot in another vehicle."""
        return _aboard(self, vehicle, velocity_gain=vehicle.tracking.velocity_gain)

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """Where all drones start."""
        del env, drones
        return state.drones.position_w

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """Towards the start, as fast as it is far."""
        del key
        wanted = self.position_gain * (memory - state.drones.position_w)
        reference = Reference(velocity_w=wanted, velocity_gain=self.velocity_gain)
        return memory, rows(env.dynamics.track(state.drones, reference, self.agility), drones, axis=1)


class Chaser(eqx.Module):
    """Chases gate after gate: a reference of constant speed towards and through the opening, tracked proportionally.

    It gives way to drones close by, by a push away from them, but plans nothing.
    """

    name: str = eqx.field(static=True, default="chaser")
    agility: float = eqx.field(static=True, default=7.5)
    vehicle: str | Vehicle = eqx.field(static=True, default="paper")
    speed: float = eqx.field(static=True, default=2.5)  # [m/s]
    velocity_gain: float = eqx.field(static=True, default=6.0)  # [1/s]
    lead: float = eqx.field(static=True, default=0.5)  # aims this share of its distance in front of the gate
    clearance: float = eqx.field(static=True, default=1.5)  # gives way to drones nearer than this [m]
    push: float = eqx.field(static=True, default=2.0)  # reference velocity away from a drone, per metre too near [1/s]

    def for_vehicle(self, vehicle: Vehicle) -> "Chaser":
        """The same pilot in another vehicle, half as fast as the vehicle's velocity loop is meant for."""
        tracking = vehicle.tracking
        return _aboard(self, vehicle, velocity_gain=tracking.velocity_gain, speed=tracking.speed / 2)

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """No memory."""
        del env, drones, state
        return ()

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """Track the velocity that leads through the gate, plus the push away from others."""
        del key
        return memory, rows(self.command(env, state, self.speed, self.push, self.agility), drones, axis=1)

    def command(
        self, env: RaceEnv, state: RaceState, speed: Scalars, push: Scalars, agility: Array | float
    ) -> Float[Array, "A N *B"]:
        """Actions of all drones; `speed`, `push` and `agility` may differ from the pilot's own, drone by drone."""
        position = state.drones.position_w
        to_aim = aim_point(env.course_of(state), state.next_gate, position, self.lead) - position
        wanted = speed * to_aim / (norm(to_aim) + EPSILON)
        if state.opponents is None:
            wanted += push_apart(position, state.airborne, self.clearance, push)
        else:
            wanted += push_from(position, state.opponents, self.clearance, push)
        wanted = wanted.at[2].max(FLOOR - position[2])
        reference = Reference(velocity_w=wanted, velocity_gain=self.velocity_gain)
        return env.dynamics.track(state.drones, reference, agility)


BEHIND = 0.1  # a drone less than this before the gate's plane, and not in line with the opening, flies around [m]
AROUND = 3.0  # way point of the detour: this far before the gate and this far to the side [m]
FLOOR = 0.4  # sinks towards this height ever more slowly, and climbs below it [m]
THROUGH = 1.0  # a drone in line with the opening aims at least this far behind it [m]


def aim_point(course: Course, gate: Array, position_w: Float[Array, "3 *B"], lead: float) -> Float[Array, "3 *B"]:
    """Where to fly for a gate: on its axis, before it while far, through it when near; around it from behind [m]."""
    centre, normal = pick(course.position_w, gate), pick(course.normal_w, gate)
    offset = position_w - centre
    forward = normal[0] * offset[0] + normal[1] * offset[1]
    left = normal[0] * offset[1] - normal[1] * offset[0]
    aside = jnp.maximum(jnp.abs(left), jnp.abs(offset[2]))
    passed_by = (forward > -BEHIND) & (forward > BEHIND - aside)
    along = jnp.where(passed_by, -AROUND, THROUGH - lead * norm(offset))
    across = jnp.where(passed_by & (forward > -AROUND / 2), jnp.where(left > 0, AROUND, -AROUND), 0.0)
    x = centre[0] + normal[0] * along - normal[1] * across
    y = centre[1] + normal[1] * along + normal[0] * across
    return jnp.stack([x, y, centre[2]])


def push_apart(
    position_w: Float[Array, "3 N *B"], airborne: Array, clearance: float, strength: Scalars
) -> Float[Array, "3 N *B"]:
    """Velocity away from every drone in the air nearer than `clearance` [m/s]."""

    def visit(push: Array, _: Array | int, theirs_w: Array, here: Array) -> Array:
        return push + _push(position_w - theirs_w, here, clearance, strength)

    push: Array = over_opponents(visit, jnp.zeros_like(position_w), (position_w, 1), (airborne, 0))
    return push


def push_from(
    position_w: Float[Array, "3 N *B"], opponents: Opponents, clearance: float, strength: Scalars
) -> Float[Array, "3 N *B"]:
    """The same away from opponents as they are perceived."""
    return _push(position_w[:, None] - opponents.position_w, opponents.present, clearance, strength).sum(axis=1)


def _push(
    offset_w: Float[Array, "3 *B"], here: Array, clearance: float, strength: Array | float
) -> Float[Array, "3 *B"]:
    distance = norm(offset_w)
    too_near = jnp.maximum(clearance - distance, 0.0) * here
    return strength * too_near * offset_w / (distance + EPSILON)


SCRIPTED: dict[str, Pilot] = {pilot.name: pilot for pilot in (Chaser(), Hover())}
