"""The environment: pure functions that start, step and observe a race, or any batch of races."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from cruise.config import Randomisation, RewardWeights, Track, Vehicle
from cruise.dynamics import DroneState, Dynamics
from cruise.env.gates_now import course_now, course_of_start, gates_and_told, over_step, with_gates_at
from cruise.env.mixed import Fleet, Group, each_of, groups_of, make_mixed
from cruise.env.observation import (
    OBSERVATIONS,
    action_decoder,
    find_observation,
    observation_layout,
    observation_vector,
)
from cruise.env.payment import Reward, make_reward
from cruise.env.randomise import perturbation
from cruise.env.sensing import Sensed, sensed_after, settled
from cruise.env.step_events import Flown, in_order
from cruise.env.step_view import StepView
from cruise.env.surroundings import AS_SAID, Conditions, gust_w
from cruise.env.types import Collisions, RaceState, Rules, StepOutcome
from cruise.env.view import View
from cruise.racing.contacts import meet_opponents, meet_solids, on_ground, out_of_bounds
from cruise.racing.course import Course, make_course
from cruise.racing.field import rows
from cruise.racing.gates import follow_gates
from cruise.racing.grid import Start, spread_start, start_grid
from cruise.racing.passes import passes_per_step
from cruise.racing.start_room import StartPlan, spread_plan, start_plan
from cruise.terms import Entry, Observation, Setting

FLIP_ANGLE = jnp.pi / 2

Observe = Callable[[RaceState], Array]
Decode = Callable[..., Array]  # (state, action [A, n, *B], drones=None)
Perturb = Callable[[Array, tuple[int, ...]], Conditions]  # (key, (N, *B)) -> what those races are like


class RaceEnv(NamedTuple):
    """Static choices of a race and the functions built from them."""

    num_drones: int
    track: Track
    vehicle: Vehicle  # of all drones; in a mixed field of the first, or of those whose pilot is asked
    course: Course
    dynamics: Dynamics
    reset: Callable[..., RaceState]  # (key, batch=(), gate=None, spread=0.0, start=None) -> state
    begin: Callable[..., RaceState]  # (start grid, conditions) -> state
    step: Callable[[RaceState, Array, Rules], tuple[RaceState, StepOutcome]]
    observe: Observe  # [O, N, *B], of the kind the environment was made with
    decode: Decode  # actions of all drones, or of some, from a policy's frame to that of the vehicle
    observe_as: dict[str, Observe]  # every kind, for pilots that were trained on another
    decode_as: dict[str, Decode]
    reward: Reward
    groups: tuple[Group, ...]  # the drones by vehicle

    @property
    def vehicles(self) -> tuple[Vehicle, ...]:
        """Of every drone."""
        return tuple(next(group.vehicle for group in self.groups if i in group.drones) for i in range(self.num_drones))

    def of_drones(self, drones: tuple[int, ...]) -> "RaceEnv":
        """The environment as it is to who flies some drones, all of one vehicle: their own in place of the field's."""
        if len(self.groups) == 1:
            return self
        own = next(group for group in self.groups if set(drones) <= set(group.drones))
        decode_as = _decoders(self.course, own.dynamics)
        return self._replace(vehicle=own.vehicle, dynamics=own.dynamics, decode_as=decode_as)

    def layout(self, observation: str) -> tuple[Entry, ...]:
        """What the numbers of an observation are, in their order. Raises CruiseError where it is not known."""
        return observation_layout(observation, Setting(self.num_drones, self.course.num_gates, self.dynamics))

    def course_of(self, state: RaceState) -> Course:
        """The gates of a race, or of each race of a batch, as they stand now: the track's, unless they have moved."""
        return course_now(self.course, state.surroundings)

    def with_gates_at(self, state: RaceState) -> RaceState:
        """The race with its gates where they stand at its step; the same race where none of them moves."""
        return with_gates_at(self.course, self.dynamics.control_dt, state)


def _course_of(course: Course, drones: tuple[int, ...], ndim: int) -> Course:
    """The course of some drones, where every one believes its gates elsewhere: it has an axis for each of `ndim`."""
    tables = course.position_w, course.normal_w
    if tables[0].ndim < 2 + ndim:
        return course
    position, normal = (rows(table, drones, axis=2) for table in tables)
    return course._replace(position_w=position, normal_w=normal)


def _informed(course: Course, dynamics: Dynamics, state: RaceState, sense: Callable[..., Sensed]) -> RaceState:
    """With what the drones know, where that is not everything."""
    surroundings = state.surroundings
    if surroundings.sensed is None:
        return state
    gates, told = gates_and_told(course, dynamics.control_dt, state)
    sensed = sense(surroundings.sensed, state, gates, told, dynamics.rotation(state.drones))
    return state._replace(surroundings=surroundings._replace(sensed=sensed))


def _air_w(dynamics: Dynamics, state: RaceState) -> Float[Array, "3 N *B"] | None:
    """What moves the air at each drone beside a steady wind: the rotors of the others, and gusts."""
    air_w = dynamics.induced_air(state.drones, state.airborne) if dynamics.induced_air else None
    gusts = state.surroundings.gusts
    if gusts is None:
        return air_w
    gust = jnp.broadcast_to(gust_w(gusts, state.step * dynamics.control_dt)[:, None], state.drones.position_w.shape)
    return gust if air_w is None else air_w + gust


def _flipped(vehicles: tuple[Vehicle, ...], dynamics: Dynamics, drones: DroneState) -> Bool[Array, "N *B"]:
    """Rolled or pitched past 90 degrees, where that is a crash."""
    ends = np.array([vehicle.flip_ends for vehicle in vehicles])
    if not ends.any():
        return jnp.zeros(drones.position_w.shape[1:], bool)
    roll, pitch, _ = dynamics.euler(drones)
    flipped = (jnp.abs(roll) > FLIP_ANGLE) | (jnp.abs(pitch) > FLIP_ANGLE)
    return flipped if ends.all() else flipped & ends.reshape(-1, *(1,) * (flipped.ndim - 1))


def _freeze(dynamics: Dynamics, frozen: Bool[Array, "N *B"], old: DroneState, new: DroneState) -> DroneState:
    def kept(frozen: Array, old: Any, new: Any) -> Any:
        return jax.tree.map(lambda a, b: jnp.where(frozen, a, b), old, new)

    if dynamics.groups is None:
        return kept(frozen, old, new)
    memories = zip(dynamics.groups, old.memory, new.memory, strict=True)
    memory = tuple(kept(rows(frozen, drones, 0), before, after) for drones, before, after in memories)
    return kept(frozen, old._replace(memory=()), new._replace(memory=()))._replace(memory=memory)


def _met_drones(
    segment: tuple[Array, Array], airborne: Array, distance: Array | float, until: list[Array], aspect: float
) -> tuple[Array, list[Array], Array]:
    """As `meet_opponents`, and whether another drone was met within the step."""
    if jnp.ndim(distance) == 0:
        nearest, touched = meet_opponents(*segment, airborne, distance, until, aspect)
        return nearest, touched, nearest < distance
    until = [*until, jnp.ones_like(until[0])]  # drones of different sizes: of each pair by itself
    nearest, touched = meet_opponents(*segment, airborne, distance, until, aspect)
    return nearest, touched[:-1], touched[-1]


def _who_flies_what(vehicles: tuple[Vehicle, ...], dynamics: Dynamics | None) -> tuple[tuple[Group, ...], Dynamics]:
    """The drones by vehicle, and what moves them all: `dynamics` where it is given."""
    groups = groups_of(vehicles)
    if len(groups) > 1:
        return groups, dynamics or make_mixed(groups)
    alone = groups[0]._replace(dynamics=dynamics or groups[0].dynamics)
    return (alone,), alone.dynamics


def _some_spread(course: Course, key: Array, start: Start, share: float, plan: StartPlan | None) -> Start:
    """Each race with probability `share` from a spread start in place of `start`."""
    start_key, chosen_key = jax.random.split(key)
    drones, *batch = start.heading.shape
    along = spread_start(course, start_key, drones, tuple(batch), plan)
    chosen = jax.random.uniform(chosen_key, tuple(batch)) < share
    return Start(*(jnp.where(chosen, one, other) for one, other in zip(along, start, strict=True)))


def make_race_env(
    track: Track,
    num_drones: int,
    vehicle: Fleet,
    observation: str = "extended",
    reward: RewardWeights | Reward | None = None,
    perturb: Perturb | None = None,
    dynamics: Dynamics | None = None,
) -> RaceEnv:
    """Build the functions of a race. Options are settled here, not inside the step.

    Args:
        track: where.
        num_drones: how many.
        vehicle: what all of them fly, or each of them.
        observation: what `observe` gives.
        reward: weights, by default those of `RewardWeights`, or terms.
        perturb: draws what the races that `reset` starts are like, `cruise.env.randomise.perturbation` among them; by
            default they are as vehicle and track say, each on a variant of the track where that has any.
        dynamics: what moves the drones; by default our own equations of the vehicle.

    Raises:
        CruiseError: vehicles that cannot share a race.
    """
    vehicles = each_of(vehicle, num_drones)
    groups, dynamics = _who_flies_what(vehicles, dynamics)
    paid = reward if isinstance(reward, Reward) else make_reward(reward or RewardWeights())
    env_course = make_course(track)
    passes = passes_per_step(track, dynamics.control_dt)
    plan = start_plan(track, num_drones)
    perturb = perturb or perturbation(track, vehicles, Randomisation())
    aspect = max(one.collision_aspect for one in vehicles)

    def begin(start: Start, conditions: Conditions = AS_SAID) -> RaceState:
        drones = dynamics.init(start.position_w, start.heading, conditions.parameters)
        shape = start.heading.shape
        none = jnp.zeros(shape, bool)
        gate = jnp.broadcast_to(start.gate, shape).astype(jnp.int32)  # of no weak type: a step gives none
        counts = jnp.zeros(shape, jnp.int32)
        state = RaceState(drones, gate, counts, none, none, counts[0], conditions.surroundings)
        return _informed(env_course, dynamics, with_gates_at(env_course, dynamics.control_dt, state), settled)

    def reset(
        key: Array,
        batch: tuple[int, ...] = (),
        gate: int | None = None,
        spread: float = 0.0,
        start: Start | None = None,
    ) -> RaceState:
        """`spread`: share of the races whose drones start all along the track. `start`: where they do in any case."""
        start_key, conditions_key, spread_key = jax.random.split(key, 3)
        conditions = perturb(conditions_key, (num_drones, *batch)) if perturb else AS_SAID
        here = course_of_start(env_course, dynamics.control_dt, conditions.surroundings, batch)
        drawn = start_grid(here, start_key, num_drones, batch, gate, plan)
        if spread:
            drawn = _some_spread(here, spread_key, drawn, spread, spread_plan(track, num_drones))
        return begin(start or drawn, conditions)

    def step(state: RaceState, action: Float[Array, "A N *B"], rules: Rules) -> tuple[RaceState, StepOutcome]:
        airborne, (course, surroundings) = state.airborne, over_step(env_course, dynamics.control_dt, state)
        moved = dynamics.step(state.drones, action, rules.agility, _air_w(dynamics, state))
        drones = _freeze(dynamics, ~airborne, state.drones, moved)
        start_w, end_w = state.drones.position_w, drones.position_w
        crossings = follow_gates(course, start_w, end_w, state.next_gate, rules.gate_tolerance, passes)
        until = [crossing.fraction for crossing in crossings]
        nearest, touched, met_drone = _met_drones((start_w, end_w), airborne, rules.collision_distance, until, aspect)
        met = meet_solids(course, start_w, end_w)
        hits = {kind: fraction <= 1 for kind, fraction in met.items()}
        hits |= {
            "drone": met_drone,
            "ground": on_ground(end_w),
            "gate_frame": crossings[0].hit_frame,
            "bounds": out_of_bounds(course, end_w),
            "flip": _flipped(vehicles, dynamics, drones),
        }
        nothing = jnp.zeros(airborne.shape, bool)
        collisions = Collisions(*(hits[kind] & airborne if kind in hits else nothing for kind in Collisions._fields))
        flown = Flown(start_w, end_w, airborne, state.gates_passed)
        happened = in_order(course, flown, crossings, touched, met, collisions, rules)

        crossing, *further = happened.crossings
        view = StepView(
            View(course, dynamics, state), drones, action, happened.crossings, nearest, happened.solid, rules
        )
        components = paid.components(view)
        reward = paid.total(rules, components, crossing.passed, happened.terminated, view.gates_passed)
        outcome = StepOutcome(
            reward=jnp.where(airborne, reward, 0.0),
            components=components,
            terminated=happened.terminated,
            crossing=crossing,
            collisions=collisions,
            further=tuple(further),
        )
        passed = outcome.gates_passed
        next_state = RaceState(
            drones=drones,
            next_gate=(state.next_gate + passed) % course.num_gates,
            gates_passed=state.gates_passed + passed,
            out=state.out | happened.terminated,
            finished=state.finished | happened.finished,
            step=state.step + 1,
            surroundings=surroundings,
        )
        return _informed(env_course, dynamics, next_state, sensed_after), outcome

    def observe(seen: Observation, state: RaceState) -> Array:
        return observation_vector(seen, course_now(env_course, state.surroundings), dynamics, state)

    find_observation(observation)
    observe_as: dict[str, Observe] = {name: functools.partial(observe, seen) for name, seen in OBSERVATIONS.items()}
    decode_as = _decoders(env_course, groups[0].dynamics)
    return RaceEnv(
        num_drones=num_drones,
        track=track,
        vehicle=vehicles[0],
        course=env_course,
        dynamics=dynamics,
        reset=reset,
        begin=begin,
        step=step,
        observe=observe_as[observation],
        decode=decode_as[observation],
        observe_as=observe_as,
        decode_as=decode_as,
        reward=paid,
        groups=groups,
    )


def _decoders(course: Course, dynamics: Dynamics) -> dict[str, Decode]:
    """By observation, how actions of all drones of a vehicle, or of some, become the vehicle's."""
    return {name: functools.partial(_decode, course, dynamics, seen) for name, seen in OBSERVATIONS.items()}


def _decode(
    course: Course,
    dynamics: Dynamics,
    seen: Observation,
    state: RaceState,
    action: Array,
    drones: tuple[int, ...] | None = None,
) -> Array:
    here, gate = course_now(course, state.surroundings), state.next_gate
    if drones is not None:
        here, gate = _course_of(here, drones, gate.ndim), rows(gate, drones, axis=0)
    return action_decoder(seen, dynamics)(here, gate, action)
