"""Stable-Baselines3's interface to many races: a thin layer over the vector environment."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from cruise.adapters.gymnasium_env import start_of
from cruise.adapters.gymnasium_vector import VectorRaceEnv
from cruise.errors import CruiseError


class StableBaselinesEnv(VecEnv):
    """`PPO("MlpPolicy", StableBaselinesEnv(1024, track="ring", drones=2))`."""

    def __init__(self, num_envs: int, **options: Any) -> None:
        """As `VectorRaceEnv`, with races that begin anew in the step in which they end; this is what SB3 expects."""
        self.env = VectorRaceEnv(num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **options)
        self._actions: np.ndarray | None = None
        super().__init__(num_envs, self.env.single_observation_space, self.env.single_action_space)

    def reset(self) -> np.ndarray:
        """Observations [E, O] of new races, with the seeds and the options that were set for them."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, _ = self.env.reset(seed=seeds, options=self._start())
        self._reset_seeds()
        self._reset_options()
        return observations

    def _start(self) -> dict[str, Any] | None:
        """One start for all races from the options of each."""
        starts = [start_of(options) for options in self._options]
        if all(start is None for start in starts):
            return None
        if any(start is None for start in starts):
            raise CruiseError("set_options: a start must be given for every race, or for none")
        places, gates = ([getattr(start, name) for start in starts] for name in ("position_w", "gate"))
        return {"start": {"position_w": np.stack(places), "gate": np.array(gates)}}

    def step_async(self, actions: np.ndarray) -> None:
        """Take notice of the actions [E, A]."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards, ends, and information by race: what PPO needs to know of episodes that have ended."""
        assert self._actions is not None
        observations, rewards, terminated, truncated, infos = self.env.step(self._actions)
        ended = terminated | truncated
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for race in np.flatnonzero(ended):
            told[race] = {
                "terminal_observation": infos["final_obs"][race],
                "TimeLimit.truncated": bool(truncated[race]),
                "finished": bool(infos["final_info"]["finished"][race]),
                "gates_passed": int(infos["final_info"]["gates_passed"][race]),
            }
        return observations, rewards, ended, told

    def get_images(self) -> Sequence[np.ndarray | None]:
        """A picture of every race, for `VecVideoRecorder`; it needs `render_mode="rgb_array"`."""
        return self.env.render() or [None] * self.num_envs

    def close(self) -> None:
        """Close the races."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The same for every race: of the environment, or one of its options."""
        value = getattr(self.env, attr_name) if hasattr(self.env, attr_name) else getattr(self.env.options, attr_name)
        return [value] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """For all races at once."""
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """The same for every race."""
        return [getattr(self.env, method_name)(*args, **kwargs)] * len(self._chosen(indices))

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """No race is wrapped."""
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices: VecEnvIndices) -> Sequence[int]:
        return list(self._get_indices(indices))
