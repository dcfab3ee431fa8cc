"""A batch of races under one compiled step, with NumPy arrays outside: what every adapter is a thin layer over."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cruise.adapters.compiled import Carry, Plan, Reset, begin, fly_step
from cruise.adapters.options import Setup
from cruise.env.types import RaceState
from cruise.errors import CruiseError
from cruise.pilots.python_pilot import separate_python_pilots
from cruise.precision import single_precision
from cruise.racing.grid import Start
from cruise.rollout import ask_python

Info = dict[str, Any]  # arrays [E, L], or dictionaries of such


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
    """Races that are flown from outside."""

    @single_precision
    def __init__(self, setup: Setup, num_races: int, mode: Reset) -> None:
        """Nothing is compiled before the first reset."""
        self.setup, self.num_races = setup, num_races
        groups, self._python_pilots = separate_python_pilots(setup.env, setup.groups)
        self._plan = Plan(setup.env, groups, setup.learners, setup.observation, mode, jnp.int32(setup.limit))
        self._carry: Carry | None = None
        self._shape = (num_races, len(setup.learners), setup.env.dynamics.action_size)

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
        if seeds is not None:
            words = np.array([[seed & 0xFFFFFFFF, (seed >> 32) & 0xFFFFFFFF] for seed in seeds], np.uint32)
            keys = _keys(words)
        else:
            keys = self._running().keys
        grid = None if start is None else start.grid(self.setup, self.num_races)
        old = None if mask is None or mask.all() else self._running()
        if old is not None:
            keys = _chosen(jnp.asarray(mask), keys, old.keys)
        self._carry, seen = begin(self._plan, keys, grid, old, None if old is None else jnp.asarray(mask))
        return _stepped(seen)

    @single_precision
    def step(self, actions: np.ndarray) -> Stepped:
        """Fly one control step with actions [E, L, A]."""
        given = np.asarray(actions, np.float32)
        if given.shape != self._shape:
            raise CruiseError(f"actions have shape {list(given.shape)}, expected {list(self._shape)}")
        if not np.isfinite(given).all():
            raise CruiseError("actions must be finite numbers in [-1, 1], got some that are not finite")
        carry = self._running()
        if self._python_pilots:
            carry = carry._replace(memories=ask_python(self._python_pilots, carry.memories, carry.state))
        self._carry, seen = fly_step(self._plan, self.setup.rules, carry, jnp.asarray(given))
        return _stepped(seen)

    def _running(self) -> Carry:
        if self._carry is None:
            raise CruiseError("the environment was not reset: call reset() before step()")
        return self._carry


class StandingStart(NamedTuple):
    """Where drones wait for the start."""

    position_w: np.ndarray  # [N, 3] in every race, or [E, N, 3] [m]
    gate: np.ndarray | int  # the first to pass, in every race or [E]

    def grid(self, setup: Setup, races: int) -> Start:
        """As the environment wants it. Raises CruiseError where the shapes are not right."""
        drones, gates = setup.env.num_drones, setup.env.course.num_gates
        try:
            position = np.broadcast_to(np.asarray(self.position_w, np.float32), (races, drones, 3))
            gate = np.broadcast_to(np.asarray(self.gate, np.int32), (races,))
        except (TypeError, ValueError):
            raise CruiseError(f"a start has positions [{drones}, 3] or [{races}, {drones}, 3], and a gate") from None
        if not (np.isfinite(position).all() and ((gate >= 0) & (gate < gates)).all()):
            raise CruiseError(f"a start has finite positions, and a gate from 0 to {gates - 1}")
        if setup.env.track.variants:
            raise CruiseError(
                f"a start needs a track whose gates are known, and {setup.env.track.name!r} is drawn anew"
            )
        x, y = np.asarray(setup.env.course.normal_w)[:, gate]
        heading = np.broadcast_to(np.arctan2(y, x), (drones, races))
        return Start(jnp.asarray(position.transpose(2, 1, 0)), jnp.asarray(heading), jnp.asarray(gate))


def _stepped(seen: dict) -> Stepped:
    """On the host, as arrays that may be written to."""
    return Stepped(**jax.tree.map(np.array, seen))


@jax.jit
def _keys(words: Array) -> Array:
    return jax.vmap(lambda w: jax.random.fold_in(jax.random.key(w[0]), w[1]))(words)


@jax.jit
def _chosen(mask: Array, new: Array, old: Array) -> Array:
    return jnp.where(mask, new, old)
