"""A batch of races under one compiled step, with NumPy arrays outside: what every adapter is a thin layer over."""

import copy
import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from cruise.adapters.compiled import Carry, Reset, begin_first, fly_step, key_of
from cruise.adapters.options import RaceOptions, choose
from cruise.adapters.setup import Setup, set_up
from cruise.adapters.workers import start_jax
from cruise.env.types import RaceState
from cruise.errors import CruiseError
from cruise.precision import single_precision
from cruise.racing.course import course_at
from cruise.racing.grid import Start
from cruise.rollout import ask_python

Info = dict[str, np.ndarray]  # [E, L] each


class Stepped(NamedTuple):
    """What a step, or a reset, did; races E first, then the L drones that learn."""

    observation: np.ndarray  # [E, L, O] to act on next
    reward: np.ndarray  # [E, L]
    terminated: np.ndarray  # [E, L] crashed or finished in this step
    truncated: np.ndarray  # [E, L] still racing when the time was over
    active: np.ndarray  # [E, L] was racing when the step began
    over: np.ndarray  # [E] the episode of the race has ended
    info: Info
    final_observation: np.ndarray | None = None  # [E, L, O] of the step itself where a new episode has begun already
    final_info: Info | None = None  # likewise


class Races:
    """Races that are flown from outside. Before the first reset nothing of JAX runs, and nothing is compiled."""

    def __init__(self, options: RaceOptions, everybody_learns: bool, num_races: int, mode: Reset) -> None:
        """Raises CruiseError where the options do not go together."""
        self._asked = (options, everybody_learns)
        self.choices, self.num_races, self.mode = choose(*self._asked), num_races, mode
        self._setup: Setup | None = None
        self._carry: Carry | None = None
        self._pickled = False  # the races are NumPy's still

    def many(self, num_races: int) -> "Races":
        """So many of these races, before the first reset."""
        races = copy.copy(self)
        races.num_races = num_races
        return races

    def __getstate__(self) -> dict[str, Any]:
        """Options, and the races as they are in NumPy: what another process builds them from, without JAX."""
        kept = {"asked": self._asked, "num_races": self.num_races, "mode": self.mode}
        return kept | {"carry": jax.tree.map(np.asarray, self._carry)}

    def __setstate__(self, kept: dict[str, Any]) -> None:
        """As they were."""
        self.__init__(*kept["asked"], kept["num_races"], kept["mode"])  # type: ignore[misc]
        self._carry, self._pickled = kept["carry"], True

    @property
    def setup(self) -> Setup:
        """What is flown, built at the first use. Raises CruiseError where an opponent does not fit the race."""
        if self._setup is None:
            start_jax()
            self._setup = set_up(self.choices, self.mode)
        return self._setup

    @property
    def state(self) -> RaceState:
        """The races as they are, on the device. Raises CruiseError before the first reset."""
        return self._running().state

    @single_precision
    def reset(
        self, seeds: Sequence[int] | None = None, mask: np.ndarray | None = None, start: "StandingStart | None" = None
    ) -> Stepped:
        """Begin races anew.

        Args:
            seeds: one for each race; the same seed gives the same races, in any batch. By default the races go on with
                the randomness they have.
            mask: [E] which races; by default all.
            start: where the drones stand; by default drawn.
        """
        start_jax()
        if seeds is not None:
            words = [[seed & 0xFFFFFFFF, (seed >> 32) & 0xFFFFFFFF] for seed in seeds]
            keys = _keys(self.setup.plan.race, np.array(words, np.uint32))
        else:
            keys = self._running().keys
        grid = None if start is None else start.grid(self.setup, self.num_races)
        old = None if mask is None or mask.all() else self._running()
        if old is not None:
            keys = jnp.where(jnp.asarray(mask), keys, old.keys)
        self._carry, seen = begin_first(self.setup.plan, keys, grid, old, None if old is None else jnp.asarray(mask))
        return _stepped(seen)

    @single_precision
    def step(self, actions: np.ndarray) -> Stepped:
        """Fly one control step with actions [E, L, A]."""
        given = np.asarray(actions, np.float32)
        expected = (self.num_races, len(self.choices.learners), self.choices.action.size)
        if given.shape != expected:
            raise CruiseError(f"actions have shape {list(given.shape)}, expected {list(expected)}")
        if not np.isfinite(given).all():
            raise CruiseError("actions must be finite numbers in [-1, 1], got some that are not finite")
        carry, setup = self._running(), self.setup
        if setup.python_pilots:
            commanded = setup.plan.commanded
            memories = ask_python(setup.python_pilots, (*(None,) * commanded, *carry.memories), carry.state)
            carry = carry._replace(memories=memories[commanded:])
        self._carry, seen = fly_step(setup.plan, setup.rules, carry, jnp.asarray(given))
        return _stepped(seen)

    def _running(self) -> Carry:
        if self._carry is None:
            raise CruiseError("the environment was not reset: call reset() before step()")
        start_jax()
        if self._pickled:
            self._carry, self._pickled = jax.tree.map(jnp.asarray, self._carry), False
        return self._carry


class StandingStart(NamedTuple):
    """Where drones wait for the start."""

    position_w: np.ndarray  # [N, 3] in every race, or [E, N, 3] [m]
    gate: np.ndarray | int  # the first to pass, in every race or [E]

    def grid(self, setup: Setup, races: int) -> Start:
        """As the environment wants it. Raises CruiseError where the shapes are not right."""
        env = setup.env
        drones, gates = env.num_drones, env.course.num_gates
        try:
            position = np.broadcast_to(np.asarray(self.position_w, np.float32), (races, drones, 3))
            gate = np.broadcast_to(np.asarray(self.gate, np.int32), (races,))
        except (TypeError, ValueError):
            raise CruiseError(f"a start has positions [{drones}, 3] or [{races}, {drones}, 3], and a gate") from None
        if not (np.isfinite(position).all() and ((gate >= 0) & (gate < gates)).all()):
            raise CruiseError(f"a start has finite positions, and a gate from 0 to {gates - 1}")
        if env.track.variants:
            raise CruiseError(f"a start needs a track whose gates are known, and {env.track.name!r} is drawn anew")
        x, y = np.asarray(course_at(env.course, 0.0).normal_w)[:, gate]
        heading = np.broadcast_to(np.arctan2(y, x), (drones, races))
        return Start(jnp.asarray(position.transpose(2, 1, 0)), jnp.asarray(heading), jnp.asarray(gate))


def _stepped(seen: dict) -> Stepped:
    """On the host, as arrays that may be written to."""
    return Stepped(**jax.tree.map(np.array, seen))


@functools.partial(jax.jit, static_argnums=0)
def _keys(race: bool, words: jax.Array) -> jax.Array:
    """[K, E] the data of a key for every race."""
    return jax.random.key_data(jax.vmap(lambda word: key_of(race, *word))(words)).T
