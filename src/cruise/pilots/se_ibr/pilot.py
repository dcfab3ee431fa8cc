"""SE-IBR in receding horizon: a pilot that plans anew every tenth of a second for all drones of a race."""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from cruise.config import Vehicle
from cruise.env.mixed import as_one
from cruise.env.race_env import RaceEnv
from cruise.env.surroundings import as_known_by
from cruise.env.types import RaceState
from cruise.errors import CruiseError
from cruise.pilots.base import must_know
from cruise.pilots.se_ibr.centre_line import make_centre_line, start_progress
from cruise.pilots.se_ibr.game import Plan, Traffic, best_responses, first_plan, shifted
from cruise.pilots.se_ibr.options import Algorithm, Style
from cruise.pilots.se_ibr.settings import Setting, style_of
from cruise.pilots.se_ibr.tracking import Moment, Tracker, tracker_of
from cruise.pilots.se_ibr.trajectory import make_trajectory
from cruise.racing.field import rows
from cruise.racing.motion import must_stand_still
from cruise.vector import norm
from cruise.vehicles import find_vehicle, fly_alike, reference_to


class PlannerMemory(NamedTuple):
    """The plan that is flown, and where it began."""

    style: Style  # of every drone, as arrays
    plan: Plan
    position_w: Float[Array, "3 N *B"]  # of all drones when it was made [m]
    velocity_w: Float[Array, "3 N *B"]  # [m/s]
    age: Int[Array, ""]  # control steps since it was made


def _traced(style: Style | Setting) -> Style | Setting:
    """A style as arrays, so that another one compiles nothing."""
    return Style(*(jnp.asarray(value, jnp.float32) for value in style)) if isinstance(style, Style) else style


class SeIbrPilot(eqx.Module):
    """Sensitivity-enhanced iterative best response (Wang, Taubner and Schwager, 2020) for any number of drones.

    It plans for all drones from the state of the race, its opponents' included, as if all of them planned as it does,
    and flies its own part of the plan. `docs/se-ibr.md` describes the game.
    """

    style: Style | Setting = eqx.field(converter=_traced)  # numbers, or arrays that broadcast over [N, *B]; or by name
    name: str = eqx.field(static=True, default="se-ibr")
    algorithm: Algorithm = eqx.field(static=True, default=Algorithm())
    agility: float = eqx.field(static=True, default=7.5)
    vehicle: str | Vehicle = eqx.field(static=True, default="paper")

    def for_vehicle(self, vehicle: Vehicle) -> "SeIbrPilot":
        """The same pilot in another vehicle; plans of a faster one look less far ahead in time."""
        own = find_vehicle(self.vehicle)
        if vehicle == own:
            return self
        slower = own.tracking.speed / vehicle.tracking.speed
        dt = max(slower * self.algorithm.dt, self.algorithm.period)
        algorithm = dataclasses.replace(self.algorithm, dt=dt)
        return dataclasses.replace(self, algorithm=algorithm, vehicle=reference_to(vehicle), agility=vehicle.agility)

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> PlannerMemory:
        """A first guess along the centre line. Raises CruiseError where the race's vehicle is not the pilot's."""
        vehicle = find_vehicle(self.vehicle)
        if not fly_alike(vehicle, env.vehicle):
            raise CruiseError(f"pilot {self.name!r} flies vehicle {vehicle.name!r}, which is not the one of this race")
        must_know(env.track, self.name)
        must_stand_still(env.track, f"pilot {self.name!r} plans along")
        line = make_centre_line(env.track)
        style = self.style if isinstance(self.style, Style) else style_of(self.style, env.track, vehicle)
        style = Style(*(_per_drone(value, state.next_gate.ndim) for value in style))
        state = as_known_by(state, drones)
        state = state._replace(drones=as_one(env.groups, state.drones))
        traffic = _traffic(style, self._tracker(env), drones, state)
        progress = start_progress(line, traffic.position_w, state.next_gate)
        plan = first_plan(line, self.algorithm, traffic, progress)
        age = jnp.int32(self._period(env))  # so old that it is time to plan
        return PlannerMemory(style, plan, traffic.position_w, traffic.velocity_w, age)

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: PlannerMemory, state: RaceState, key: Array
    ) -> tuple[PlannerMemory, Float[Array, "A n *B"]]:
        """Plan when it is time to, and follow the plan."""
        del key
        state = as_known_by(state, drones)
        state = state._replace(drones=as_one(env.groups, state.drones))
        line, period = make_centre_line(env.track), self._period(env)
        tracker = self._tracker(env)
        traffic = _traffic(memory.style, tracker, drones, state)
        algorithm = dataclasses.replace(self.algorithm, limit=tracker.limit)

        def plan_anew(memory: PlannerMemory) -> PlannerMemory:
            guess = shifted(line, memory.plan, algorithm.period / algorithm.dt)
            plan = best_responses(line, algorithm, memory.style, traffic, guess)
            return PlannerMemory(memory.style, plan, traffic.position_w, traffic.velocity_w, jnp.int32(0))

        if period == 1:
            memory = plan_anew(memory)
        else:
            memory = jax.lax.cond(memory.age >= period, plan_anew, lambda kept: kept, memory)
        trajectory = make_trajectory(memory.position_w, memory.velocity_w, memory.plan.position_w, self.algorithm.dt)
        moment = Moment(state.drones, memory.age * env.dynamics.control_dt, memory.style.lead, self.agility)
        action = tracker.command(trajectory, moment)
        return memory._replace(age=memory.age + 1), rows(action, drones, axis=1)

    def _tracker(self, env: RaceEnv) -> Tracker:
        return tracker_of(find_vehicle(self.vehicle), env.dynamics)

    def _period(self, env: RaceEnv) -> int:
        """Control steps from one planning to the next."""
        return max(1, round(self.algorithm.period / env.dynamics.control_dt))


def _per_drone(value: Any, ndim: int) -> Array:
    """A number, one number per drone, or numbers per drone and race, as an array that broadcasts over [N, *B]."""
    array = jnp.asarray(value, jnp.float32)
    return array.reshape(-1, *(1,) * (ndim - 1)) if array.ndim == 1 else array


def _traffic(style: Style, tracker: Tracker, drones: tuple[int, ...], state: RaceState) -> Traffic:
    """What the planner sees. Its own drones keep its top speed; an opponent that is faster is taken to stay as fast."""
    position, velocity = tracker.ahead(state.drones)
    own = jnp.array([drone in drones for drone in range(state.next_gate.shape[0])])
    own = own.reshape(-1, *(1,) * (state.next_gate.ndim - 1))
    speed = jnp.broadcast_to(style.speed, state.next_gate.shape)
    top = jnp.where(own, speed, jnp.maximum(speed, norm(velocity)))
    return Traffic(position, velocity, state.airborne, top)
