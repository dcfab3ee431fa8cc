"""`gymnasium.make_vec("cruise/Race-v0", num_envs=1024)`: many races in one compiled step."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike

from cruise.adapters.compiled import Reset
from cruise.adapters.gymnasium_env import start_of
from cruise.adapters.options import RaceOptions, set_up
from cruise.adapters.races import Races
from cruise.adapters.rendering import Screen
from cruise.adapters.spaces import action_box, observation_box
from cruise.errors import CruiseError

MODES: dict[AutoresetMode, Reset] = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}


class VectorRaceEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Races with one learner each. Race `i` with seed `s` is that of `RaceEnv` with seed `s`, whatever the others are.

    Observations [E, O], actions [E, A]. Every information is an array [E] beside its mask `_name`, as Gymnasium has it.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  (as the base class)

    def __init__(
        self,
        num_envs: int = 1,
        options: RaceOptions | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        """Build the environment.

        Args:
            num_envs: number of races.
            options: what is raced; see `RaceOptions`.
            autoreset_mode: when a race that has ended begins anew. `SAME_STEP`: at once, its last observation and
                information in `infos["final_obs"]` and `infos["final_info"]`. `NEXT_STEP`: in the next step, whose
                action for it is ignored. `DISABLED`: in `reset(options={"reset_mask": ...})`.
            render_mode: `rgb_array` or None.
            changes: single options, such as `track="ring"` or `opponents=["ring-2"]`.

        Raises:
            CruiseError: the options do not go together.
        """
        if num_envs < 1:
            raise CruiseError(f"num_envs must be 1 or more, got {num_envs}")
        if render_mode not in (None, "rgb_array"):
            raise CruiseError(f"unknown render_mode {render_mode!r} of the vector environment; there is rgb_array")
        self.options = (options or RaceOptions()).changed(changes)
        setup = set_up(self.options, everybody_learns=False)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        rate = round(1 / setup.env.dynamics.control_dt)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode, "render_fps": rate}
        self.num_envs, self.render_mode = num_envs, render_mode
        self._races = Races(setup, num_envs, MODES[self.autoreset_mode])
        self.single_observation_space = observation_box(setup)
        self.single_action_space = action_box(setup)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._screen = Screen(setup)
        self._begun = False
        self._ended = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict]:
        """Start the races.

        Args:
            seed: of the first race, one more for each that follows; or one for each.
            options: `reset_mask` [E] of booleans: start these races alone. `start`: as in `RaceEnv`, with `position_w`
                [N, 3] or [E, N, 3] and `gate`, one or [E].
        """
        mask = _mask(options, self.num_envs)
        super().reset(seed=seed if isinstance(seed, int) else None)
        seeds = self._seeds(seed)
        seen = self._races.reset(seeds, mask, start_of(options))
        self._begun = True
        self._ended &= ~(np.ones_like(self._ended) if mask is None else mask)
        self._screen.begin()
        self._follow()
        told = np.ones(self.num_envs, bool) if mask is None else mask
        return seen.observation[:, 0], masked(seen.info, told)

    def step(self, actions: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Fly one control step of every race.

        Args:
            actions: [E, A] in [-1, 1], in the frame of the observation.

        Returns:
            Observations [E, O], rewards, terminations, truncations [E], and information.

        Raises:
            CruiseError: actions have another shape or are not finite, a race that has ended was not reset though
                nobody else does it, or an opponent in Python fails.
        """
        given = np.asarray(actions)
        if given.shape != self.action_space.shape:
            raise CruiseError(f"actions have shape {list(given.shape)}, expected {list(self.action_space.shape or ())}")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            raise CruiseError(
                "a race that has ended must be reset before the next step: reset(options={'reset_mask': ...})"
            )
        seen = self._races.step(given[:, None])
        self._ended = seen.over
        self._follow()
        infos = masked(seen.info, np.ones(self.num_envs, bool))
        if seen.final_observation is not None and seen.over.any():
            assert seen.final_info is not None
            final = np.full(self.num_envs, None, dtype=object)
            for race in np.flatnonzero(seen.over):
                final[race] = seen.final_observation[race, 0]
            infos |= {"final_obs": final, "_final_obs": seen.over.copy()}
            infos |= {"final_info": masked(seen.final_info, seen.over), "_final_info": seen.over.copy()}
        return seen.observation[:, 0], seen.reward[:, 0], seen.terminated[:, 0], seen.truncated[:, 0], infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture [H, W, 3] of every race."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() needs render_mode="rgb_array"')
            return None
        state = self._races.state
        return tuple(self._screen.picture(self._screen.frame(state, race)) for race in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Nothing is kept open."""

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int] | None:
        if seed is None and self._begun:
            return None
        if isinstance(seed, int | np.integer):
            return [int(seed) + race for race in range(self.num_envs)]
        given = [None] * self.num_envs if seed is None else list(seed)
        if len(given) != self.num_envs:
            raise CruiseError(f"{len(given)} seeds for {self.num_envs} races")
        drawn = self.np_random.integers(2**32, size=self.num_envs).tolist()
        return [own if one is None else int(one) for one, own in zip(given, drawn, strict=True)]

    def _follow(self) -> None:
        if self.render_mode is not None:
            self._screen.follow(self._races.state)


def _mask(options: dict[str, Any] | None, races: int) -> np.ndarray | None:
    mask = (options or {}).get("reset_mask")
    if mask is None:
        return None
    if not isinstance(mask, np.ndarray) or mask.shape != (races,) or mask.dtype != np.bool_ or not mask.any():
        raise CruiseError(f"options['reset_mask'] must be an array of {races} booleans, one of them True at least")
    return mask


def masked(info: dict[str, Any], told: np.ndarray) -> dict[str, Any]:
    """Information of the first learner of each race, with the masks that Gymnasium puts beside it."""
    result: dict[str, Any] = {}
    for name, value in info.items():
        result[name] = masked(value, told) if isinstance(value, dict) else value[:, 0]
        result[f"_{name}"] = told.copy()
    return result
