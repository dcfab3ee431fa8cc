"""`cruise.vector_parallel_env(1024)`: PettingZoo's parallel interface, with arrays [E, ...] for single values."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from cruise.adapters.gymnasium_env import start_of
from cruise.adapters.options import RaceOptions
from cruise.adapters.pettingzoo_env import Values, agents_of
from cruise.adapters.races import Races
from cruise.adapters.spaces import action_box, observation_box
from cruise.errors import CruiseError


class VectorParallelRaceEnv:
    """Races in which every drone is an agent. Dictionaries by agent hold arrays whose first axis is the race.

    A drone that has left its race stays in the arrays: `infos[agent]["active"]` says who flew the step. A race whose
    last drone has left, or whose time is over, begins anew in the same step; what its drones saw last is then in
    `infos[agent]["final_obs"]`, where `infos[agent]["_final_obs"]` is true.
    """

    def __init__(self, num_envs: int, options: RaceOptions | None = None, **changes: Any) -> None:
        """Settle what is raced; see `cruise.adapters.pettingzoo_env.ParallelRaceEnv`."""
        if num_envs < 1:
            raise CruiseError(f"num_envs must be 1 or more, got {num_envs}")
        self.options = (options or RaceOptions()).changed(changes)
        self._races = Races(self.options, True, num_envs, "same_step")
        choices = self._races.choices
        self.num_envs = num_envs
        self.agents = self.possible_agents = agents_of(choices)
        self._observation_space, self._action_space = observation_box(choices), action_box(choices)
        self._begun = False

    def observation_space(self, agent: str) -> gymnasium.spaces.Space:
        """[O] float32, of one race."""
        return self._observation_space

    def action_space(self, agent: str) -> gymnasium.spaces.Space:
        """[A] float32 in [-1, 1], of one race."""
        return self._action_space

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Values, Values]:
        """Start all races; race `i` is that of `ParallelRaceEnv` with seed `seed + i`.

        Returns:
            Observations [E, O] and information [E] by agent.
        """
        if seed is None and not self._begun:
            seed = int(np.random.default_rng().integers(2**32))
        self._begun = True
        seeds = None if seed is None else [seed + race for race in range(self.num_envs)]
        seen = self._races.reset(seeds, start=start_of(options))
        infos = {agent: _of(seen.info, k) | {"active": seen.active[:, k]} for k, agent in enumerate(self.agents)}
        return self._by_agent(seen.observation), infos

    def step(self, actions: Mapping[str, ArrayLike]) -> tuple[Values, Values, Values, Values, Values]:
        """Fly one control step of every race.

        Args:
            actions: [E, A] in [-1, 1] by agent, for every agent; those of drones that have left are not read.

        Returns:
            Observations [E, O], rewards, terminations, truncations and information [E], by agent.

        Raises:
            CruiseError: an agent has no actions, or they have another shape or are not finite.
        """
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise CruiseError(f"agent {missing[0]!r} has no actions; there must be some for each agent")
        seen = self._races.step(np.stack([np.asarray(actions[agent], np.float32) for agent in self.agents], axis=1))
        infos = {}
        for k, agent in enumerate(self.agents):
            infos[agent] = _of(seen.info, k) | {"active": seen.active[:, k]}
            if seen.over.any() and seen.final_observation is not None and seen.final_info is not None:
                infos[agent] |= {"final_obs": seen.final_observation[:, k], "_final_obs": seen.over}
                infos[agent] |= {"final_info": _of(seen.final_info, k), "_final_info": seen.over}
        told = (seen.observation, seen.reward, seen.terminated, seen.truncated)
        observations, rewards, terminations, truncations = (self._by_agent(values) for values in told)
        return observations, rewards, terminations, truncations, infos

    def close(self) -> None:
        """Nothing is kept open."""

    def _by_agent(self, values: np.ndarray) -> Values:
        return {agent: values[:, k] for k, agent in enumerate(self.agents)}


def _of(info: dict[str, Any], drone: int) -> dict[str, Any]:
    return {name: value[:, drone] for name, value in info.items()}
