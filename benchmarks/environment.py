"""The environment alone: random actions, observation, reward and auto-reset, as training resets."""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec
from jaxtyping import Array, Bool, Float

from benchmarks.machine import available_memory_mb, platform_kind
from benchmarks.roofline import count
from cruise.config import Gate, ObservationKind, Track, TrainConfig
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.types import RaceState, Rules, stage_rules
from cruise.presets import CURRICULA, TRACKS, VEHICLES
from cruise.racing.grid import Start, start_grid
from cruise.training.devices import AXIS, choose_devices, make_mesh
from cruise.training.experience import ACTIVE, begin_again

TRACK = "ring"
EPISODE_STEPS = 600
COLLISION_DISTANCE = TrainConfig().collision_distance  # [m]
MOST_STEPS, LEAST_STEPS = 64, 16  # per call
DRONE_STEPS = 2**21  # per call, about
STRIDE = 16  # by which the table of random actions is shifted from step to step
BLOCK = 256  # at most so many races side by side on a core: with all they see they fit into its cache


class Races(NamedTuple):
    """What goes from step to step."""

    state: RaceState
    restart: Bool[Array, "E"]
    observation: Float[Array, "O N E"] | None
    reward: Float[Array, "N E"]  # summed
    restarts: Array


class EnvironmentCase:
    """Races in parallel under random actions. Its unit is the step of one drone.

    Every device flies its share of the races, a core block after block, each block for all steps of a call. For each it
    draws a pool of starts; actions are slices, at another offset in every step, of a table drawn beforehand, because
    generating random numbers is not what is measured. A race in which the first drone is out begins anew from the pool
    at the start of the next step. The observation is part of what the loop carries, so that it is there in full at
    every step.
    """

    def __init__(
        self,
        races: int,
        drones: int = 4,
        observation: ObservationKind | None = "extended",
        vehicle: str = "paper",
        track: Track = TRACKS[TRACK],
    ) -> None:
        """Compile it; without `observation` nobody looks."""
        self.races, self.observation = races, observation
        self.steps = max(LEAST_STEPS, min(MOST_STEPS, DRONE_STEPS // (races * drones)))
        self.work = float(races * drones * self.steps)
        self.env: RaceEnv = make_race_env(track, drones, VEHICLES[vehicle], observation or "extended")
        self.rules: Rules = jax.tree.map(jnp.asarray, stage_rules(CURRICULA[vehicle][-1], COLLISION_DISTANCE))
        self._key = jax.random.key(races)
        self._mesh = make_mesh(choose_devices(races))
        self.block = block_size(races // self._mesh.size, platform_kind())
        shape = (self.env.dynamics.action_size, drones, self.block + self.steps * STRIDE)
        self._actions = np.random.default_rng(races).uniform(-1.0, 1.0, shape).astype(np.float32)
        self.carried = self._none_begun()
        traced = jax.jit(self._on_devices()).trace(self.carried, self._actions, self._key)
        self.cost = count(traced.jaxpr).times(1 / self.work)
        self._run = traced.lower().compile()

    def __call__(self) -> None:
        """Go on with the races for `steps` steps."""
        self._key, key = jax.random.split(self._key)
        self.carried = jax.block_until_ready(self._run(self.carried, self._actions, key))

    def _none_begun(self) -> Races:
        """Empty races, [blocks, ..., races of a block], that all begin in the first step."""

        def first(key: Array) -> Races:
            state = self.env.reset(key, (self.block,))
            reward = jnp.zeros((self.env.num_drones, self.block))
            return Races(state, jnp.zeros(self.block, bool), self._look(state), reward, jnp.int32(0))

        blocks = self.races // self.block
        shapes = jax.eval_shape(first, self._key)
        empty = jax.tree.map(lambda leaf: np.zeros((blocks, *leaf.shape), leaf.dtype), shapes)
        spread = NamedSharding(self._mesh, PartitionSpec(AXIS))
        placed: Races = jax.device_put(empty._replace(restart=~empty.restart), spread)
        return placed

    def _look(self, state: RaceState) -> Array | None:
        return None if self.observation is None else self.env.observe(state)

    def _draw_starts(self, key: Array) -> Start:
        """As many new starts per step as training draws, one per race every 64 steps, repeated to fill the block."""
        new = math.ceil(self.block * self.steps / MOST_STEPS)
        drawn = start_grid(self.env.course, key, self.env.num_drones, (new,))
        times = math.ceil(self.block / new)
        return Start(*(jnp.concatenate([x] * times, axis=-1)[..., : self.block] for x in drawn))

    def _on_devices(self) -> Callable[[Races, Array, Array], Races]:
        spread, everywhere = PartitionSpec(AXIS), PartitionSpec()

        def advance_all(carried: Races, actions: Array, key: Array) -> Races:
            keys = jax.random.split(jax.random.fold_in(key, jax.lax.axis_index(AXIS)), len(carried.restart))
            return jax.lax.map(lambda block: self._advance(block[0], actions, block[1]), (carried, keys))

        return jax.shard_map(
            advance_all,
            mesh=self._mesh,
            in_specs=(spread, everywhere, everywhere),
            out_specs=spread,
            check_vma=False,
        )

    def _advance(self, carried: Races, actions: Array, key: Array) -> Races:
        begun = self.env.begin(self._draw_starts(key))

        def step(races: Races, t: Array) -> tuple[Races, None]:
            state = begin_again(races.state, begun, races.restart)
            seen = self._look(state)
            action = jax.lax.dynamic_slice_in_dim(actions, t * STRIDE, self.block, axis=-1)
            state, outcome = self.env.step(state, action, self.rules)
            restart = outcome.terminated[ACTIVE] | (state.step >= EPISODE_STEPS)
            return Races(state, restart, seen, races.reward + outcome.reward, races.restarts + restart.sum()), None

        carried, _ = jax.lax.scan(step, carried, jnp.arange(self.steps))
        return carried


def round_track(gates: int) -> Track:
    """So many gates in a circle, 4 m apart, each facing along it."""
    radius = 4.0 / (2 * math.sin(math.pi / gates))
    angles = [2 * math.pi * k / gates for k in range(gates)]
    placed = [Gate((radius * math.cos(a), radius * math.sin(a), 1.5), a + math.pi / 2) for a in angles]
    reach = radius + 8.0
    return Track(f"{gates} gates", tuple(placed), (-reach, -reach, 0.0), (reach, reach, 8.0))


def block_size(races: int, platform: str = "cpu") -> int:
    """The largest number of races up to BLOCK that divides them all; all of them where there are thousands of lanes."""
    if platform != "cpu":
        return races
    return max(size for size in range(1, BLOCK + 1) if races % size == 0)


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
