"""Drones of different vehicles in one field: each flies by its own vehicle's equations, told what that one is told.

Drones of one vehicle step together, as they would in a race of their own: for them a mixed field changes nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from cruise.config import Vehicle
from cruise.dynamics import DroneState, Dynamics, FreeBody, Parameters, Reference, make_dynamics, quaternion
from cruise.dynamics.downwash import induced_air_w
from cruise.dynamics.parameters import AS_BUILT
from cruise.errors import CruiseError
from cruise.racing.field import rows
from cruise.terms import Term

Fleet = Vehicle | tuple[Vehicle, ...]  # of all drones, or of each


class Group(NamedTuple):
    """The drones of one vehicle in a field."""

    drones: tuple[int, ...]
    vehicle: Vehicle
    dynamics: Dynamics


def each_of(fleet: Fleet, drones: int) -> tuple[Vehicle, ...]:
    """The vehicle of every drone. Raises CruiseError where there are not as many, or they cannot share a race."""
    vehicles = (fleet,) * drones if isinstance(fleet, Vehicle) else tuple(fleet)
    if len(vehicles) != drones:
        raise CruiseError(f"a race of {drones} drones needs {drones} vehicles, or one for all, not {len(vehicles)}")
    first = vehicles[0]
    for other in vehicles:
        fault = _fault(first, other)
        if fault:
            raise CruiseError(f"vehicles {first.name!r} and {other.name!r} cannot share a race: {fault}")
    return vehicles


def collision_distances(fleet: tuple[Vehicle, ...]) -> tuple[float, ...]:
    """At which drones collide in a real race: one for all, or each its own [m]."""
    each = tuple(vehicle.collision_distance for vehicle in fleet)
    return each[:1] if len(set(each)) == 1 else each


def _fault(one: Vehicle, other: Vehicle) -> str | None:
    if one.control_dt != other.control_dt:
        return f"one is told something every {one.control_dt:g} s, the other every {other.control_dt:g} s"
    if one.flown_by != other.flown_by:
        return f"one is flown by its {one.flown_by}, the other by its {other.flown_by}"
    return None


def groups_of(vehicles: Sequence[Vehicle]) -> tuple[Group, ...]:
    """Drones by vehicle, in the order of the first drone of each."""
    return tuple(
        Group(tuple(drone for drone, own in enumerate(vehicles) if own == one), one, make_dynamics(one))
        for one in dict.fromkeys(vehicles)
    )


def field_dynamics(groups: tuple[Group, ...]) -> Dynamics:
    """What moves all drones."""
    return make_mixed(groups) if len(groups) > 1 else groups[0].dynamics


class _Field(NamedTuple):
    """All groups of a mixed field."""

    groups: tuple[Group, ...]

    def split(self, state: DroneState) -> list[DroneState]:
        """The drones of every group as a field of their own."""
        ndim = state.position_w.ndim - 1
        return [
            DroneState(
                type(state.body)(*(self.own(part, group, ndim) for part in state.body)),
                state.memory[place],
                self.parameters(state.parameters, group, ndim),
            )
            for place, group in enumerate(self.groups)
        ]

    def join(self, states: Sequence[DroneState], parameters: Parameters) -> DroneState:
        """The field of such drones; what controllers remember is a tuple of the groups' memories."""
        bodies = [state.body for state in states]
        body = type(bodies[0])(*(self.merged(parts, 1) for parts in zip(*bodies, strict=True)))
        return DroneState(body, tuple(state.memory for state in states), parameters)

    def merged(self, parts: Sequence[Array], axis: int) -> Array:
        """Arrays of all groups as one, in the order of the drones."""
        order = np.argsort([drone for group in self.groups for drone in group.drones])
        return jnp.concatenate(parts, axis=axis).take(order, axis=axis)

    def own(self, value: Any, group: Group, ndim: int) -> Any:
        """A group's rows of an array over [N, *B], which has so many axes; what has no drones is for all."""
        if not hasattr(value, "ndim") or value.ndim < ndim or value.shape[-ndim] == 1:
            return value
        return rows(value, group.drones, value.ndim - ndim)

    def parameters(self, parameters: Parameters, group: Group, ndim: int) -> Parameters:
        """Those of a group."""
        return Parameters(*(self.own(value, group, ndim) for value in parameters))


def make_mixed(groups: tuple[Group, ...]) -> Dynamics:
    """The whole field as one; actions of those who are told fewer numbers end with some that nobody reads."""
    field, first = _Field(groups), groups[0].dynamics
    widest = max((group.dynamics for group in groups), key=lambda one: one.action_size)

    def init(position_w: Array, heading: Array, parameters: Parameters = AS_BUILT) -> DroneState:
        ndim = heading.ndim
        states = [
            group.dynamics.init(
                rows(position_w, group.drones, 1),
                rows(heading, group.drones, 0),
                field.parameters(parameters, group, ndim),
            )
            for group in groups
        ]
        return field.join(states, parameters)

    def step(state: DroneState, action: Array, agility: Array | float, air_w: Array | None = None) -> DroneState:
        ndim, after = action.ndim - 1, []
        for group, own in zip(groups, field.split(state), strict=True):
            told = rows(action[: group.dynamics.action_size], group.drones, 1)
            scale, air = field.own(agility, group, ndim), field.own(air_w, group, ndim)
            after.append(group.dynamics.step(own, told, scale, air))
        return field.join(after, state.parameters)

    def track(state: DroneState, reference: Reference, agility: Array | float) -> Float[Array, "A N *B"]:
        ndim, parts = state.position_w.ndim - 1, []
        for group, own in zip(groups, field.split(state), strict=True):
            wanted = Reference(*(field.own(value, group, ndim) for value in reference))
            action = group.dynamics.track(own, wanted, field.own(agility, group, ndim))
            parts.append(padded(action, widest.action_size))
        return field.merged(parts, 1)

    def term(kind: str, number: int) -> Term:
        def value(state: DroneState) -> Array:
            each = zip(groups, field.split(state), strict=True)
            parts = [getattr(group.dynamics, kind)[number].fn(own) for group, own in each]
            return field.merged(parts, parts[0].ndim - state.position_w.ndim + 1)

        return replace(getattr(first, kind)[number], fn=value)

    return widest._replace(
        init=init,
        step=step,
        track=track,
        proprioception=tuple(term("proprioception", i) for i in range(len(first.proprioception))),
        internal=tuple(term("internal", i) for i in range(len(first.internal))),
        induced_air=_induced_air(field),
        groups=tuple(group.drones for group in groups),
    )


def as_one(groups: tuple[Group, ...], state: DroneState) -> DroneState:
    """The field with what all controllers remember in one piece, as if it were not mixed."""
    if len(groups) == 1:
        return state
    field, ndim = _Field(groups), state.position_w.ndim - 1
    return state._replace(memory=jax.tree.map(lambda *each: field.merged(each, each[0].ndim - ndim), *state.memory))


def padded(action: Float[Array, "a *B"], size: int) -> Float[Array, "A *B"]:
    """An action with zeros behind it, so that all have so many numbers."""
    return jnp.pad(action, [(0, size - len(action)), *[(0, 0)] * (action.ndim - 1)])


def _induced_air(field: _Field) -> Callable[[DroneState, Bool[Array, "N *B"]], Array] | None:
    """The air that the rotors of those groups push whose vehicles say so; None where none does."""
    pushing = [group for group in field.groups if group.vehicle.airframe and group.vehicle.airframe.downwash]
    if not pushing:
        return None

    def air_w(state: DroneState, airborne: Bool[Array, "N *B"]) -> Float[Array, "3 N *B"]:
        assert isinstance(state.body, FreeBody)
        axis_w = jnp.stack(quaternion.thrust_axis_w(state.body.attitude))
        thrust, total = field.merged([memory.wrench[0] for memory in state.memory], 0), jnp.zeros_like(axis_w)
        for group in pushing:
            here = np.isin(np.arange(len(airborne)), group.drones).reshape(-1, *(1,) * (airborne.ndim - 1))
            assert group.vehicle.airframe is not None
            total += induced_air_w(group.vehicle.airframe.rotors, state.position_w, axis_w, thrust, airborne & here)
        return total

    return air_w
