"""What is timed: the same work done by others. Each imports its library when it is built."""

import io
from contextlib import redirect_stdout
from typing import Any

import numpy as np

from benchmarks.environment import TRACK
from benchmarks.headline import DRONES
from benchmarks.peers.plain_race import PlainRace


class PlainEnvironment:
    """Random actions in the plain environment, everybody observed. Its unit is the step of one drone."""

    def __init__(self, steps: int = 200) -> None:
        self.work = float(steps * DRONES)
        self.env = PlainRace(DRONES)
        self.env.reset(seed=0)
        self._actions = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, DRONES, 3))

    def __call__(self) -> None:
        for actions in self._actions:
            _, ended = self.env.fly(actions)
            for drone in range(DRONES):
                self.env.look(drone)
            if ended[0]:
                self.env.reset()


class Learning:
    """A trainer of another library. Its unit is the environment step of the learner."""

    def __init__(self, model: Any) -> None:
        self.model = model
        self.work = float(model.n_steps * model.n_envs)  # of one rollout with its update
        self()

    def __call__(self) -> None:
        with redirect_stdout(io.StringIO()):
            self.model.learn(int(self.work), reset_num_timesteps=False)


def stable_baselines_as_the_paper() -> Learning:
    """Stable-Baselines3's own defaults on four environments, one process, the plain environment."""
    from stable_baselines3 import PPO  # noqa: PLC0415
    from stable_baselines3.common.vec_env import DummyVecEnv  # noqa: PLC0415

    return Learning(PPO("MlpPolicy", DummyVecEnv([lambda: PlainRace(DRONES)] * 4), device="cpu", seed=0))


def stable_baselines_on_ours(races: int = 512, **settings: Any) -> Learning:
    """Stable-Baselines3 on our vector interface, opponents included: with `settings`, or the sizes of our own PPO."""
    from stable_baselines3 import PPO  # noqa: PLC0415

    return Learning(PPO("MlpPolicy", _ours(races), device="cpu", seed=0, **(settings or _sizes(races))))


def sbx_on_ours(races: int = 512) -> Learning:
    """The same with SBX, Stable-Baselines3 in JAX."""
    from sbx import PPO  # noqa: PLC0415

    return Learning(PPO("MlpPolicy", _ours(races), seed=0, **_sizes(races)))


def _ours(races: int) -> Any:
    from cruise.adapters.sb3 import StableBaselinesEnv  # noqa: PLC0415

    return StableBaselinesEnv(races, track=TRACK, drones=DRONES)


def _sizes(races: int) -> dict[str, Any]:
    return {"n_steps": 64, "batch_size": races * 64 // 16, "n_epochs": 4, "policy_kwargs": {"net_arch": [64, 64]}}
