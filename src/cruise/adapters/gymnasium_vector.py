"""`gymnasium.make_vec("cruise/Race-v0", num_envs=1024)` and `"cruise/Field-v0"`: many races in one compiled step."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike

from cruise.adapters.compiled import Reset
from cruise.adapters.gymnasium_env import Limited, start_of
from cruise.adapters.options import RaceOptions
from cruise.adapters.races import Races, Stepped
from cruise.adapters.rendering import Screen
from cruise.adapters.spaces import action_box, observation_box
from cruise.errors import CruiseError

MODES: dict[AutoresetMode, Reset] = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}


class VectorRaceEnv(Limited, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Races with one learner each. Race `i` with seed `s` is that of `RaceEnv` with seed `s`, whatever the others are.

    Observations [R, O], actions [R, A] of R rows: learners, race by race. Every information is an array [R] beside its
    mask `_name`, as Gymnasium has it.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  (as the base class)
    everybody_learns = False

    def __init__(
        self,
        num_envs: int = 1,
        options: RaceOptions | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        """Settle what is raced; it is built, and JAX started, at the first reset.

        Args:
            num_envs: number of rows R.
            options: what is raced; see `RaceOptions`.
            autoreset_mode: when a race that has ended begins anew. `NEXT_STEP`: in the next step, whose action for it
                is ignored. `SAME_STEP`: at once, its last observation and information in `infos["final_obs"]` and
                `infos["final_info"]`. `DISABLED`: in `reset(options={"reset_mask": ...})`.
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
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        races = Races(self.options, self.everybody_learns, 1, MODES[self.autoreset_mode])
        self._learners = len(races.choices.learners)
        if num_envs % self._learners:
            raise CruiseError(f"num_envs must be a multiple of the {self._learners} drones of a race, got {num_envs}")
        self._races = races.many(num_envs // self._learners)
        rate = round(1 / races.choices.vehicle.control_dt)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode, "render_fps": rate}
        self.num_envs, self.render_mode = num_envs, render_mode
        self.single_observation_space = observation_box(races.choices)
        self.single_action_space = action_box(races.choices)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._screen = Screen(self._races)
        self._begun = False
        self._ended = np.zeros(self._races.num_races, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict]:
        """Start the races.

        Args:
            seed: of the first race, one more for each that follows; or one for each.
            options: `reset_mask` [E] of booleans: start these races alone. `start`: as in `RaceEnv`, with `position_w`
                [N, 3] or [E, N, 3] and `gate`, one or [E].
        """
        mask = _mask(options, self._races.num_races)
        super().reset(seed=seed if isinstance(seed, int) else None)
        seen = self._races.reset(self._seeds(seed), mask, start_of(options))
        self._begun = True
        told = np.ones_like(self._ended) if mask is None else mask
        self._ended &= ~told
        self._screen.begin()
        self._follow()
        return self._rows(seen.observation), self._masked(seen.info, self._of_rows(told))

    def step(self, actions: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Fly one control step of every race.

        Args:
            actions: [R, A] in [-1, 1], in the frame of the observation.

        Returns:
            Observations [R, O], rewards, terminations, truncations [R], and information.

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
        seen = self._races.step(given.reshape(self._races.num_races, self._learners, -1))
        self._ended = seen.over
        self._follow()
        terminated, truncated = self._rows(seen.terminated), self._cut_off(seen)
        info = seen.info | ({"active": seen.active} if self.everybody_learns else {})
        infos = self._masked(info, np.ones(self.num_envs, bool))
        over = terminated | truncated
        if seen.final_observation is not None and over.any():
            assert seen.final_info is not None
            final = np.full(self.num_envs, None, dtype=object)
            last = self._rows(seen.final_observation)
            for row in np.flatnonzero(over):
                final[row] = last[row]
            infos |= {"final_obs": final, "_final_obs": over.copy()}
            infos |= {"final_info": self._masked(seen.final_info, over), "_final_info": over.copy()}
        return self._rows(seen.observation), self._rows(seen.reward), terminated, truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture [H, W, 3] of every row's race."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() needs render_mode="rgb_array"')
            return None
        pictures = [self._screen.picture(self._screen.frame(race)) for race in range(self._races.num_races)]
        return tuple(picture for picture in pictures for _ in range(self._learners))

    def close_extras(self, **kwargs: Any) -> None:
        """Nothing is kept open."""

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int] | None:
        races = self._races.num_races
        if seed is None and self._begun:
            return None
        if isinstance(seed, int | np.integer):
            return [int(seed) + race for race in range(races)]
        given = [None] * races if seed is None else list(seed)
        if len(given) != races:
            raise CruiseError(f"{len(given)} seeds for {races} races")
        drawn = self.np_random.integers(2**32, size=races).tolist()
        return [own if one is None else int(one) for one, own in zip(given, drawn, strict=True)]

    def _follow(self) -> None:
        if self.render_mode is not None:
            self._screen.follow()

    def _rows(self, values: np.ndarray) -> np.ndarray:
        """[E, L, ...] to [R, ...]."""
        return values.reshape(self.num_envs, *values.shape[2:])

    def _of_rows(self, values: np.ndarray) -> np.ndarray:
        """What is said of races [E], of each of their rows [R]."""
        return np.repeat(values, self._learners)

    def _cut_off(self, seen: Stepped) -> np.ndarray:
        """[R] the rows that are truncated."""
        return self._rows(seen.truncated)

    def _masked(self, info: dict[str, Any], told: np.ndarray) -> dict[str, Any]:
        """Information of the rows, with the masks that Gymnasium puts beside it."""
        result: dict[str, Any] = {}
        for name, value in info.items():
            result |= {name: self._rows(value), f"_{name}": told.copy()}
        return result


class VectorFieldEnv(VectorRaceEnv):
    """Races in which every drone learns: each is a row, for libraries of single agents whose policy all drones share.

    Row `i N + k` is drone `k` of race `i`, which is that of PettingZoo with the same seed. A drone that crashes or
    finishes is terminated. Its row then waits, with no reward and `infos["active"]` False, until its race is over,
    where it is truncated; so an episode of a row that waited is worth nothing.
    """

    everybody_learns = True

    def _cut_off(self, seen: Stepped) -> np.ndarray:
        return self._rows(seen.truncated) | (self._of_rows(seen.over) & ~self._rows(seen.active))


def _mask(options: dict[str, Any] | None, races: int) -> np.ndarray | None:
    mask = (options or {}).get("reset_mask")
    if mask is None:
        return None
    if not isinstance(mask, np.ndarray) or mask.shape != (races,) or mask.dtype != np.bool_ or not mask.any():
        raise CruiseError(f"options['reset_mask'] must be an array of {races} booleans, one of them True at least")
    return mask
