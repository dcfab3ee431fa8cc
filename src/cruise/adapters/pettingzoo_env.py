"""`cruise.parallel_env()`: every drone is an agent."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import parallel_to_aec

from cruise.adapters.gymnasium_env import RENDER_MODES, single, start_of
from cruise.adapters.options import Choices, RaceOptions
from cruise.adapters.races import Races, Stepped
from cruise.adapters.rendering import Screen
from cruise.adapters.spaces import action_box, observation_box
from cruise.errors import CruiseError

Values = dict[str, Any]  # by agent


class ParallelRaceEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """A race of agents `drone_0`, `drone_1` ... `docs/gymnasium.md` describes spaces, rewards and information.

    An agent that crashes or finishes is terminated and leaves; the time limit truncates whoever is left.
    """

    metadata = {"name": "cruise_race_v0", "render_modes": list(RENDER_MODES), "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, options: RaceOptions | None = None, *, render_mode: str | None = None, **changes: Any) -> None:
        """Settle what is raced; see `RaceEnv` of Gymnasium. Everybody learns, nobody is an opponent."""
        if render_mode not in (None, *RENDER_MODES):
            raise CruiseError(f"unknown render_mode {render_mode!r}; there are {', '.join(RENDER_MODES)}")
        self.options = (options or RaceOptions()).changed(changes)
        self._races = Races(self.options, True, 1, "disabled")
        choices = self._races.choices
        self.metadata = self.metadata | {"render_fps": round(1 / choices.vehicle.control_dt)}
        self.render_mode = render_mode
        self.possible_agents = agents_of(choices)
        self.agents: list[str] = []
        self.observation_spaces = {agent: observation_box(choices) for agent in self.possible_agents}
        self.action_spaces = {agent: action_box(choices) for agent in self.possible_agents}
        self.max_cycles = choices.limit
        self._screen = Screen(self._races)
        self._seen = np.zeros((choices.drones, *self.observation_spaces[self.possible_agents[0]].shape), np.float32)
        self._begun = False

    def observation_space(self, agent: str) -> gymnasium.spaces.Space:
        """[O] float32."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.spaces.Space:
        """[A] float32 in [-1, 1]."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Values, Values]:
        """Start a race; see `cruise.adapters.gymnasium_env.RaceEnv.reset`."""
        if seed is None and not self._begun:
            seed = int(np.random.default_rng().integers(2**32))
        self._begun = True
        self.agents = list(self.possible_agents)
        seen = self._races.reset(None if seed is None else [seed], start=start_of(options))
        self._screen.begin()
        self._after(seen)
        return self._told(seen.observation), self._information(seen)

    def step(self, actions: Mapping[str, ArrayLike]) -> tuple[Values, Values, Values, Values, Values]:
        """Fly one control step.

        Args:
            actions: [A] in [-1, 1] by agent, for every one of `agents`.

        Returns:
            Observations, rewards, terminations, truncations and information of the agents that flew the step.

        Raises:
            CruiseError: an agent has no action, or one of another shape, or one that is not finite.
        """
        seen = self._races.step(self._given(actions)[None])
        flown = self._told(seen.observation)
        rewards = {agent: float(value) for agent, value in self._told(seen.reward).items()}
        ended = {agent: bool(value) for agent, value in self._told(seen.terminated).items()}
        late = {agent: bool(value) for agent, value in self._told(seen.truncated).items()}
        information = self._information(seen)
        self.agents = [agent for agent in self.agents if not (ended[agent] or late[agent])]
        self._after(seen)
        return flown, rewards, ended, late, information

    def state(self) -> np.ndarray:
        """What all drones see together [N O], for critics that may know everything."""
        return self._seen.ravel()

    @property
    def state_space(self) -> gymnasium.spaces.Box:
        """Bounds of `state()`."""
        box = observation_box(self._races.choices)
        count = len(self.possible_agents)
        return gymnasium.spaces.Box(np.tile(box.low, count), np.tile(box.high, count), dtype=np.float32)

    def render(self) -> Any:
        """As `cruise.adapters.gymnasium_env.RaceEnv.render`."""
        if self.render_mode is None or self.render_mode == "human":
            return None
        return self._screen.shown(self.render_mode, 0)

    def close(self) -> None:
        """Close the window, if there is one."""
        self._screen.close()

    def _given(self, actions: Mapping[str, ArrayLike]) -> np.ndarray:
        """[N, A], 0 for who has left."""
        size = self._races.choices.action.size
        given = np.zeros((len(self.possible_agents), size), np.float32)
        for drone, agent in enumerate(self.possible_agents):
            if agent not in self.agents:
                continue
            if agent not in actions:
                raise CruiseError(
                    f"agent {agent!r} has no action; there must be one for each of {', '.join(self.agents)}"
                )
            action = np.asarray(actions[agent])
            if action.shape != (size,):
                raise CruiseError(f"action of {agent!r} has shape {list(action.shape)}, expected [{size}]")
            given[drone] = action
        return given

    def _told(self, values: np.ndarray) -> Values:
        """The entries of the agents that are there."""
        return {agent: values[0, self.possible_agents.index(agent)] for agent in self.agents}

    def _information(self, seen: Stepped) -> Values:
        return {agent: single(seen.info, self.possible_agents.index(agent)) for agent in self.agents}

    def _after(self, seen: Stepped) -> None:
        self._seen = seen.observation[0]
        if self.render_mode is None:
            return
        self._screen.follow()
        if self.render_mode == "human":
            self._screen.show(0)


def agents_of(choices: Choices) -> list[str]:
    """Names of all drones."""
    return [f"drone_{drone}" for drone in range(choices.drones)]


def parallel_env(**options: Any) -> ParallelRaceEnv:
    """As `cruise.parallel_env`: with `env` what PettingZoo's tools ask a module of."""
    return ParallelRaceEnv(**options)


def env(**options: Any) -> AECEnv:
    """The race of `parallel_env` as PettingZoo's cycle of agents, one after the other."""
    return parallel_to_aec(ParallelRaceEnv(**options))
