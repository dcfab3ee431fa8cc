"""The environment: pure functions that start, step and observe a race, or any batch of races."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.config import Randomisation, RewardWeights, Track, Vehicle
from cruise.dynamics import DroneState, Dynamics, make_dynamics
from cruise.env.observation import (
    OBSERVATIONS,
    action_decoder,
    find_observation,
    observation_layout,
    observation_vector,
)
from cruise.env.payment import Reward, make_reward
from cruise.env.randomise import perturbation
from cruise.env.step_events import Flown, in_order
from cruise.env.step_view import StepView
from cruise.env.surroundings import AS_SAID, Conditions, Surroundings, gust_w
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
    vehicle: Vehicle
    course: Course
    dynamics: Dynamics
    reset: Callable[..., RaceState]  # (key, batch=(), gate=None, spread=0.0) -> state
    begin: Callable[..., RaceState]  # (start grid, conditions) -> state
    step: Callable[[RaceState, Array, Rules], tuple[RaceState, StepOutcome]]
    observe: Observe  # [O, N, *B], of the kind the environment was made with
    decode: Decode  # actions of all drones, or of some, from a policy's frame to that of the vehicle
    observe_as: dict[str, Observe]  # every kind, for pilots that were trained on another
    decode_as: dict[str, Decode]
    reward: Reward

    def layout(self, observation: str) -> tuple[Entry, ...]:
        """What the numbers of an observation are, in their order. Raises CruiseError where it is not known."""
        return observation_layout(observation, Setting(self.num_drones, self.course.num_gates, self.dynamics))

    def course_of(self, state: RaceState) -> Course:
        """The gates of a race, or of each race of a batch: the track's, unless they have been moved."""
        return _with_gates(self.course, state.surroundings)


def _with_gates(course: Course, surroundings: Surroundings) -> Course:
    moved = surroundings.gates
    if moved is None:
        return course
    return course._replace(**{name: table for name, table in moved._asdict().items() if table is not None})


def _air_w(dynamics: Dynamics, state: RaceState) -> Float[Array, "3 N *B"] | None:
    """What moves the air at each drone beside a steady wind: the rotors of the others, and gusts."""
    air_w = dynamics.induced_air(state.drones, state.airborne) if dynamics.induced_air else None
    gusts = state.surroundings.gusts
    if gusts is None:
        return air_w
    gust = jnp.broadcast_to(gust_w(gusts, state.step * dynamics.control_dt)[:, None], state.drones.position_w.shape)
    return gust if air_w is None else air_w + gust


def _flipped(vehicle: Vehicle, dynamics: Dynamics, drones: DroneState) -> Bool[Array, "N *B"]:
    """Rolled or pitched past 90 degrees, where that is a crash."""
    if not vehicle.flip_ends:
        return jnp.zeros(drones.position_w.shape[1:], bool)
    roll, pitch, _ = dynamics.euler(drones)
    return (jnp.abs(roll) > FLIP_ANGLE) | (jnp.abs(pitch) > FLIP_ANGLE)


def _freeze(frozen: Bool[Array, "N *B"], old: DroneState, new: DroneState) -> DroneState:
    kept: DroneState = jax.tree.map(lambda a, b: jnp.where(frozen, a, b), old, new)
    return kept


def _some_spread(course: Course, key: Array, start: Start, share: float, plan: StartPlan | None) -> Start:
    """Each race with probability `share` from a spread start in place of `start`."""
    spread_key, chosen_key = jax.random.split(jax.random.fold_in(key, 1))
    drones, *batch = start.heading.shape
    along = spread_start(course, spread_key, drones, tuple(batch), plan)
    chosen = jax.random.uniform(chosen_key, tuple(batch)) < share
    return Start(*(jnp.where(chosen, one, other) for one, other in zip(along, start, strict=True)))


def make_race_env(
    track: Track,
    num_drones: int,
    vehicle: Vehicle,
    observation: str = "extended",
    reward: RewardWeights | Reward | None = None,
    perturb: Perturb | None = None,
    dynamics: Dynamics | None = None,
) -> RaceEnv:
    """Build the functions of a race. Options are settled here, not inside the step.

    Args:
        track: where.
        num_drones: how many.
        vehicle: what all of them fly.
        observation: what `observe` gives.
        reward: weights, by default those of `RewardWeights`, or terms.
        perturb: draws what the races that `reset` starts are like, `cruise.env.randomise.perturbation` among them; by
            default they are as vehicle and track say, each on a variant of the track where that has any.
        dynamics: what moves the drones; by default our own equations of the vehicle.
    """
    paid = reward if isinstance(reward, Reward) else make_reward(reward or RewardWeights())
    env_course = make_course(track)
    passes = passes_per_step(track, vehicle.control_dt)
    plan, along = start_plan(track, num_drones), spread_plan(track, num_drones)
    dynamics = dynamics or make_dynamics(vehicle)
    perturb = perturb or perturbation(track, vehicle, Randomisation())

    def begin(start: Start, conditions: Conditions = AS_SAID) -> RaceState:
        drones = dynamics.init(start.position_w, start.heading, conditions.parameters)
        shape = start.heading.shape
        none = jnp.zeros(shape, bool)
        gate = jnp.broadcast_to(start.gate, shape).astype(jnp.int32)  # of no weak type: a step gives none
        counts = jnp.zeros(shape, jnp.int32)
        return RaceState(drones, gate, counts, none, none, counts[0], conditions.surroundings)

    def reset(key: Array, batch: tuple[int, ...] = (), gate: int | None = None, spread: float = 0.0) -> RaceState:
        """`spread`: share of the races whose drones start all along the track."""
        start_key, conditions_key = jax.random.split(key)
        conditions = perturb(conditions_key, (num_drones, *batch)) if perturb else AS_SAID
        here = _with_gates(env_course, conditions.surroundings)
        start = start_grid(here, start_key, num_drones, batch, gate, plan)
        if spread:
            start = _some_spread(here, start_key, start, spread, along)
        return begin(start, conditions)

    def step(state: RaceState, action: Float[Array, "A N *B"], rules: Rules) -> tuple[RaceState, StepOutcome]:
        airborne, course = state.airborne, _with_gates(env_course, state.surroundings)
        moved = dynamics.step(state.drones, action, rules.agility, _air_w(dynamics, state))
        drones = _freeze(~airborne, state.drones, moved)
        start_w, end_w = state.drones.position_w, drones.position_w
        crossings = follow_gates(course, start_w, end_w, state.next_gate, rules.gate_tolerance, passes)
        near, aspect = rules.collision_distance, vehicle.collision_aspect
        until = [crossing.fraction for crossing in crossings]
        nearest, touched = meet_opponents(start_w, end_w, airborne, near, until, aspect)
        met = meet_solids(course, start_w, end_w)
        hits = {kind: fraction <= 1 for kind, fraction in met.items()}
        hits |= {
            "drone": nearest < near,
            "ground": on_ground(end_w),
            "gate_frame": crossings[0].hit_frame,
            "bounds": out_of_bounds(course, end_w),
            "flip": _flipped(vehicle, dynamics, drones),
        }
        nothing = jnp.zeros(airborne.shape, bool)
        collisions = Collisions(*(hits[kind] & airborne if kind in hits else nothing for kind in Collisions._fields))
        flown = Flown(start_w, end_w, airborne, state.gates_passed)
        happened = in_order(course, flown, crossings, touched, met, collisions, rules)

        crossing, *further = happened.crossings
        view = StepView(View(course, dynamics, state), drones, action, crossing, nearest, happened.solid, rules)
        components = paid.components(view)
        reward = paid.total(rules, components, crossing.passed, happened.terminated)
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
            surroundings=state.surroundings,
        )
        return next_state, outcome

    def observe(seen: Observation, state: RaceState) -> Array:
        return observation_vector(seen, _with_gates(env_course, state.surroundings), dynamics, state)

    def decode(seen: Observation, state: RaceState, action: Array, drones: tuple[int, ...] | None = None) -> Array:
        gate = state.next_gate if drones is None else rows(state.next_gate, drones, axis=0)
        return action_decoder(seen, dynamics)(_with_gates(env_course, state.surroundings), gate, action)

    find_observation(observation)
    observe_as: dict[str, Observe] = {name: functools.partial(observe, seen) for name, seen in OBSERVATIONS.items()}
    decode_as: dict[str, Decode] = {name: functools.partial(decode, seen) for name, seen in OBSERVATIONS.items()}
    return RaceEnv(
        num_drones=num_drones,
        track=track,
        vehicle=vehicle,
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
    )
