"""Brax's PPO on CRUISE's race, one drone learning against three that hold still, as a Brax environment.

It is run in a process of its own: on one device, whose loops all cores share, because with this JAX it fails on more.
"""

import functools
import queue
import threading
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State
from brax.training.agents.ppo import networks, train
from jax import Array

from benchmarks.environment import COLLISION_DISTANCE, EPISODE_STEPS, TRACK
from benchmarks.headline import DRONES
from cruise.config import PPOConfig
from cruise.env.race_env import make_race_env
from cruise.env.types import stage_rules
from cruise.presets import CURRICULUM, TRACKS, VEHICLES

OURS = PPOConfig()


def _on_each(tree: Any, devices: Sequence[jax.Device]) -> Any:
    """What `jax.device_put_replicated` was, which Brax 0.14.2 still calls."""
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * len(devices)), tree)


if not hasattr(jax, "device_put_replicated"):
    jax.device_put_replicated = _on_each


class BraxRace(Env):
    """One race; Brax vectorises it, ends its episodes and begins them anew."""

    def __init__(self, drones: int = DRONES) -> None:
        self.env = make_race_env(TRACKS[TRACK], drones, VEHICLES["paper"])
        self.rules = jax.tree.map(jnp.asarray, stage_rules(CURRICULUM[-1], COLLISION_DISTANCE))

    def reset(self, rng: Array) -> State:
        state = self.env.reset(rng)
        nothing = jnp.zeros(())
        return State(state, self.env.observe(state)[:, 0], nothing, nothing)

    def step(self, state: State, action: Array) -> State:
        everyone = jnp.zeros((self.action_size, self.env.num_drones)).at[:, 0].set(action)
        following, outcome = self.env.step(state.pipeline_state, everyone, self.rules)
        done = outcome.terminated[0].astype(jnp.float32)
        observation = self.env.observe(following)[:, 0]
        return state.replace(pipeline_state=following, obs=observation, reward=outcome.reward[0], done=done)

    @property
    def observation_size(self) -> int:
        return int(jax.eval_shape(lambda: self.env.observe(self.env.reset(jax.random.key(0)))).shape[0])

    @property
    def action_size(self) -> int:
        return self.env.dynamics.action_size

    @property
    def backend(self) -> str:
        return "cruise"


class BraxPPO:
    """Brax's `train`, held before each stretch of training until it is called. Its unit is the learner's step."""

    def __init__(self, updates: int = 4, stretches: int = 64) -> None:
        """Sizes are those of CRUISE's own PPO. Returns when the first stretch, which compiles, is over."""
        per_update = OURS.races * OURS.rollout_steps
        self.work = float(updates * per_update)
        self._go: queue.Queue[None] = queue.Queue()
        self._done: queue.Queue[Any] = queue.Queue()
        learn = functools.partial(
            train.train,
            num_timesteps=stretches * updates * per_update,
            max_devices_per_host=1,
            num_envs=OURS.races,
            episode_length=EPISODE_STEPS,
            unroll_length=OURS.rollout_steps,
            batch_size=OURS.races // OURS.minibatches,
            num_minibatches=OURS.minibatches,
            num_updates_per_batch=OURS.epochs,
            num_evals=stretches + 1,
            run_evals=False,
            network_factory=functools.partial(
                networks.make_ppo_networks, policy_hidden_layer_sizes=OURS.hidden, value_hidden_layer_sizes=OURS.hidden
            ),
            progress_fn=self._between,
        )
        threading.Thread(target=self._work, args=(learn,), daemon=True).start()
        self()

    def __call__(self) -> None:
        """One stretch of training."""
        self._go.put(None)
        told = self._done.get()
        if isinstance(told, BaseException):
            raise told

    def _work(self, learn: Any) -> None:
        self._go.get()
        try:
            learn(environment=BraxRace())
        except Exception as error:
            self._done.put(error)

    def _between(self, steps: int, _: dict) -> None:
        """Brax calls this after every stretch, and before the first."""
        if steps:
            self._done.put(None)
            self._go.get()
