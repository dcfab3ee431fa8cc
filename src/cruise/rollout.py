"""Pilots x environment -> trajectories. Knows nothing of files and screens."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cruise.env.mixed import padded
from cruise.env.race_env import RaceEnv
from cruise.env.surroundings import MovedGates, is_exact, perceive
from cruise.env.types import Collisions, RaceState, Rules, race_rules
from cruise.errors import CruiseError
from cruise.pilots.base import Crew, Memory, Pilot, crews
from cruise.pilots.python_pilot import PythonPilots, separate_python_pilots
from cruise.racing.gates import Crossing

CHUNK = 128  # control steps flown between two looks at whether every race is over


class Flight(NamedTuple):
    """What happened in one race or a batch of races, as NumPy arrays: components, then drones, then races.

    K steps lie between K + 1 samples. Sample k is the race at time `k * control_dt`; step k leads from sample k to
    sample k + 1 and is flown by the drones that are `airborne` at sample k.
    """

    control_dt: float  # [s]
    position_w: np.ndarray  # [K+1, 3, N, *B] m
    velocity_w: np.ndarray  # [K+1, 3, N, *B] m/s
    euler: np.ndarray  # [K+1, 3, N, *B] rad
    next_gate: np.ndarray  # [K+1, N, *B] int32
    airborne: np.ndarray  # [K+1, N, *B] bool
    finished: np.ndarray  # [K+1, N, *B] bool
    action: np.ndarray  # [K, A, N, *B]
    crossing: Crossing  # [K, N, *B] each
    collisions: Collisions  # [K, N, *B] each, bool
    further: tuple[Crossing, ...] = ()  # likewise, of the gates after the target: see `StepOutcome`
    moved: MovedGates | None = None  # NumPy, where races differ in their gates; of gates that move, where they rest


class _Sample(NamedTuple):
    position_w: Array
    velocity_w: Array
    euler: Array
    next_gate: Array
    airborne: Array
    finished: Array


class _Step(NamedTuple):
    before: _Sample
    action: Array
    crossing: Crossing
    collisions: Collisions
    further: tuple[Crossing, ...]


class _Carry(NamedTuple):
    state: RaceState
    memories: tuple
    step: Array


def team_rules(
    team: Sequence[Pilot],
    collision_distance: float | Sequence[float],
    gates_to_finish: int,
    batch: tuple[int, ...] = (),
) -> Rules:
    """Rules of a real race in which every drone's actions have its own pilot's scale; it may have its own distance."""

    def each(numbers: Sequence[float]) -> Array:
        return jnp.array(numbers, jnp.float32).reshape(-1, *(1,) * len(batch))

    agility = each([pilot.agility for pilot in team])
    distance = each(collision_distance) if isinstance(collision_distance, Sequence) else collision_distance
    return jax.tree.map(jnp.asarray, race_rules(agility, distance, gates_to_finish))


def fly(
    env: RaceEnv,
    team: Sequence[Pilot],
    rules: Rules,
    key: Array,
    steps: int,
    batch: tuple[int, ...] = (),
    gate: int | None = None,
) -> Flight:
    """Fly races from fresh random starts, before random gates or before `gate`.

    Args:
        env: the environment; its number of drones is the length of `team`.
        team: one pilot per drone. A pilot object that occurs more than once acts in one batch.
        rules: see `team_rules`.
        key: all randomness. The same key gives the same flight.
        steps: time limit in control steps; the flight ends sooner when every race is over.
        batch: () for one race, (E,) for E races.
        gate: index of the gate to start before, in every race.

    Raises:
        CruiseError: the team does not fit the environment.
    """
    start_key, flight_key = jax.random.split(key)
    return fly_from(env, team, rules, start_races(env, start_key, batch, gate), flight_key, steps)


def fly_from(
    env: RaceEnv, team: Sequence[Pilot], rules: Rules, state: RaceState, key: Array, steps: int, chunk: int = CHUNK
) -> Flight:
    """Fly races on from `state`; see `fly`. The result does not depend on `chunk`."""
    race = RunningRace(env, team, rules, state, key, chunk)
    while race.steps < steps:
        race.advance()
        if not race.flying:
            break
    return race.flight(steps)


class RunningRace:
    """A race, or a batch of races, that is flown on chunk by chunk: for whoever acts in between."""

    def __init__(
        self, env: RaceEnv, team: Sequence[Pilot], rules: Rules, state: RaceState, key: Array, chunk: int = 1
    ) -> None:
        """Begin at `state`; see `fly`. Raises CruiseError where the team does not fit the environment."""
        if len(team) != env.num_drones:
            raise CruiseError(f"a race of {env.num_drones} drones needs {env.num_drones} pilots, not {len(team)}")
        self.env, self.rules, self.key = env, rules, key
        self.crews, self._python = separate_python_pilots(env, crews(team, env.vehicles))
        self.chunk = 1 if self._python else chunk  # pilots in plain Python are asked between two steps
        self.memories: tuple = first_memories(env, self.crews, state)
        self._carry = _Carry(state, self.memories, jnp.int32(0))
        self._pieces: list[_Step] = []
        self._last: _Sample | None = None

    @property
    def state(self) -> RaceState:
        """Where the race is; what is assigned is where it goes on from."""
        return self._carry.state

    @state.setter
    def state(self, state: RaceState) -> None:
        self._carry = self._carry._replace(state=state)

    @property
    def steps(self) -> int:
        """Control steps flown so far."""
        return len(self._pieces) * self.chunk

    @property
    def flying(self) -> bool:
        """Whether anybody was in the air after the last step."""
        return self._last is None or bool(self._last.airborne.any())

    def advance(self) -> tuple[_Step, _Sample]:
        """Fly `chunk` steps on, by pilots with `memories`; gives what happened [chunk, ...] and the sample after it."""
        memories = self.memories
        if self._python:
            memories = ask_python(self._python, memories, self.state)
        carry = self._carry._replace(memories=memories)
        self._carry, piece, last = _fly_chunk(self.env, self.crews, self.rules, carry, self.key, self.chunk)
        self.memories = self._carry.memories
        self._last = jax.tree.map(np.asarray, last)
        self._pieces.append(jax.tree.map(np.asarray, piece))
        return self._pieces[-1], self._last

    def flight(self, steps: int) -> Flight:
        """What has been flown, cut after so many steps or where the last race was over."""
        assert self._last is not None
        surroundings = self.state.surroundings
        moved, rest = jax.tree.map(np.asarray, (surroundings.gates, surroundings.rest))
        moved = moved if rest is None else moved._replace(position_w=rest.position_w, normal_w=rest.normal_w)
        return _join(self.env, self._pieces, self._last, steps)._replace(moved=moved)


@eqx.filter_jit
def start_races(
    env: RaceEnv, key: Array, batch: tuple[int, ...], gate: int | None = None, spread: float = 0.0
) -> RaceState:
    """Fresh random starts; `spread`: the share of races that start all along the track."""
    return env.reset(key, batch, gate, spread)


@eqx.filter_jit
def _fly_chunk(
    env: RaceEnv, groups: tuple[Crew, ...], rules: Rules, carry: _Carry, key: Array, chunk: int
) -> tuple[_Carry, _Step, _Sample]:
    """The races after `chunk` more steps, what happened in them, and the sample that they end with."""

    def step(carry: _Carry, _: None) -> tuple[_Carry, _Step]:
        state = carry.state
        memories, action = act_together(env, groups, carry.memories, state, jax.random.fold_in(key, carry.step))
        action = jnp.where(state.airborne, action, 0.0)
        after, outcome = env.step(state, action, rules)
        record = _Step(_sample(env, state), action, outcome.crossing, outcome.collisions, outcome.further)
        return _Carry(after, memories, carry.step + 1), record

    carry, steps = jax.lax.scan(step, carry, length=chunk)
    return carry, steps, _sample(env, carry.state)


@eqx.filter_jit
def _measured(state: RaceState) -> RaceState:
    return perceive(state)


def first_memories(env: RaceEnv, groups: tuple[Crew, ...], state: RaceState) -> tuple:
    """The crews' memories at the start of races, which they see as they will see them later.

    Raises:
        CruiseError: a pilot cannot fly in this environment.
    """
    measured = perceive(state)
    return tuple(crew.pilot.init(env.of_drones(crew.drones), crew.drones, measured) for crew in groups)


def ask_python(pilots: PythonPilots, memories: tuple, state: RaceState) -> tuple:
    """The crews' memories with the next actions of the pilots in plain Python, which see what `act_together` shows.

    Raises:
        CruiseError: as `PythonPilots.ask`.
    """
    measured = state if is_exact(state) else _measured(state)
    return pilots.ask(measured, memories)


def act_together(
    env: RaceEnv, groups: tuple[Crew, ...], memories: tuple, state: RaceState, key: Array
) -> tuple[tuple, Array]:
    """The crews' new memories, and every crew's actions in the order of the drones [A, N, *B].

    Pilots are shown the race as their drones measure it: here, in `first_memories`, and in `ask_python`.
    """
    env, state = _observing_once(env), perceive(state)
    remembered: list[Memory] = []
    actions: list[Array] = []
    order: list[int] = []
    for i, (crew, memory) in enumerate(zip(groups, memories, strict=True)):
        own = env.of_drones(crew.drones)
        memory, action = crew.pilot.act(own, crew.drones, memory, state, jax.random.fold_in(key, i))
        remembered.append(memory)
        actions.append(action if own is env else padded(action, env.dynamics.action_size))
        order += crew.drones
    action = jnp.concatenate(actions, axis=1)
    return tuple(remembered), action if len(groups) == 1 else action[:, np.argsort(order)]


def _observing_once(env: RaceEnv) -> RaceEnv:
    """The environment for one step, in which each kind of observation is computed at most once."""
    seen: dict[str, list[tuple[RaceState, Array]]] = {}

    def observe(kind: str, state: RaceState) -> Array:
        known = seen.setdefault(kind, [])
        found = next((numbers for other, numbers in known if other is state), None)
        if found is None:
            found = env.observe_as[kind](state)
            known.append((state, found))  # one for every state: a pilot may be shown another than the others
        return found

    return env._replace(observe_as={kind: functools.partial(observe, kind) for kind in env.observe_as})


def _sample(env: RaceEnv, state: RaceState) -> _Sample:
    drones = state.drones
    return _Sample(
        drones.position_w,
        drones.velocity_w,
        env.dynamics.euler(drones),
        state.next_gate,
        state.airborne,
        state.finished,
    )


def _join(env: RaceEnv, pieces: list[_Step], last: _Sample, steps: int) -> Flight:
    """One flight of all chunks, cut at the time limit or when the last race is over."""
    joined = jax.tree.map(lambda *parts: np.concatenate(parts), *pieces)
    samples = jax.tree.map(lambda before, end: np.concatenate([before, end[None]]), joined.before, last)
    racing = samples.airborne.any(axis=tuple(range(1, samples.airborne.ndim)))
    length = min(steps, int(racing.sum()))  # no drone returns to the air, so the racing samples come first
    samples = jax.tree.map(lambda a: a[: length + 1], samples)
    joined = jax.tree.map(lambda a: a[:length], joined)
    return Flight(
        control_dt=env.dynamics.control_dt,
        **samples._asdict(),
        action=joined.action,
        crossing=joined.crossing,
        collisions=joined.collisions,
        further=joined.further,
    )
