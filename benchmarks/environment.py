"""The environment alone: random actions, observation, reward and auto-reset, as training resets."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from benchmarks.machine import available_memory_mb
from cruise.config import ObservationKind
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.types import RaceState, Rules, stage_rules
from cruise.presets import CURRICULUM, TRACKS, VEHICLES
from cruise.racing.grid import start_grid
from cruise.training.experience import ACTIVE, begin_again

TRACK = "ring"
EPISODE_STEPS = 600
COLLISION_DISTANCE = 0.5  # as in training [m]
MOST_STEPS, LEAST_STEPS = 64, 8  # per call
DRONE_STEPS = 2**21  # per call, about
STRIDE = 16  # by which the block of random actions is shifted from step to step


class Races(NamedTuple):
    """What goes from step to step."""

    state: RaceState
    restart: Bool[Array, "E"]
    observation: Float[Array, "O N E"] | None
    reward: Float[Array, "N E"]  # summed
    restarts: Array


class EnvironmentCase:
    """Races in parallel under random actions. Its unit is the step of one drone.

    A call draws a pool of starts, then steps all races; actions are slices, at another offset in every step, of a block
    drawn beforehand, because generating random numbers is not what is measured. A race in which the first drone is out
    begins anew from the pool at the start of the next step. The observation is part of what the loop carries, so that
    it is there in full at every step.
    """

    def __init__(self, races: int, drones: int = 4, observation: ObservationKind | None = "extended") -> None:
        """Compile it; without `observation` nobody looks."""
        self.races, self.observation = races, observation
        self.steps = max(LEAST_STEPS, min(MOST_STEPS, DRONE_STEPS // (races * drones)))
        self.work = float(races * drones * self.steps)
        self.env: RaceEnv = make_race_env(TRACKS[TRACK], drones, VEHICLES["paper"], observation or "extended")
        self.rules: Rules = jax.tree.map(jnp.asarray, stage_rules(CURRICULUM[-1], COLLISION_DISTANCE))
        self._key = jax.random.key(races)
        self._actions = self._draw_actions()
        self.carried = self._none_begun()
        self._run = jax.jit(self._advance).lower(self.carried, self._actions, self._key).compile()

    def __call__(self) -> None:
        """Go on with the races for `steps` steps."""
        self._key, key = jax.random.split(self._key)
        self.carried = jax.block_until_ready(self._run(self.carried, self._actions, key))

    def _draw_actions(self) -> Array:
        shape = (self.env.dynamics.action_size, self.env.num_drones, self.races + self.steps * STRIDE)
        return jax.random.uniform(self._key, shape, minval=-1.0, maxval=1.0)

    def _none_begun(self) -> Races:
        """Empty races that all begin in the first step."""

        def first(key: Array) -> Races:
            state = self.env.reset(key, (self.races,))
            reward = jnp.zeros((self.env.num_drones, self.races))
            return Races(state, jnp.zeros(self.races, bool), self._look(state), reward, jnp.int32(0))

        empty = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(first, self._key))
        return empty._replace(restart=jnp.ones_like(empty.restart))

    def _look(self, state: RaceState) -> Array | None:
        return None if self.observation is None else self.env.observe(state)

    def _advance(self, carried: Races, actions: Array, key: Array) -> Races:
        fresh = start_grid(self.env.course, key, self.env.num_drones, (self.races,))
        again = min(self.races, self.steps)
        pool = jax.tree.map(lambda x: jnp.concatenate([x, x[..., :again]], axis=-1), fresh)

        def window(rows: Array, first: Array) -> Array:
            return jax.lax.dynamic_slice_in_dim(rows, first, self.races, axis=-1)

        def step(races: Races, t: Array) -> tuple[Races, None]:
            start = jax.tree.map(lambda x: window(x, t % self.races), pool)
            state = begin_again(races.state, self.env.begin(start), races.restart)
            seen = self._look(state)
            state, outcome = self.env.step(state, window(actions, t * STRIDE), self.rules)
            restart = outcome.terminated[ACTIVE] | (state.step >= EPISODE_STEPS)
            return Races(state, restart, seen, races.reward + outcome.reward, races.restarts + restart.sum()), None

        carried, _ = jax.lax.scan(step, carried, jnp.arange(self.steps))
        return carried


def memory_needed_mb(races: int, drones: int) -> float:
    """About what a case holds at once: the loop's state twice, and the pool twice [MB]."""
    env = make_race_env(TRACKS[TRACK], drones, VEHICLES["paper"])
    state = jax.eval_shape(lambda key: env.reset(key, (races,)), jax.random.key(0))
    observation = jax.eval_shape(env.observe, state)
    held = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves((state, observation)))
    return 4 * held / 1e6


def that_fit(races: tuple[int, ...], drones: int = 4) -> tuple[int, ...]:
    """Those numbers of races of which all cases together take at most half of the memory left."""
    fitting: list[int] = []
    needed = 0.0
    for number in sorted(races):
        needed += memory_needed_mb(number, drones)
        if needed <= available_memory_mb() / 2:
            fitting.append(number)
    return tuple(fitting)
