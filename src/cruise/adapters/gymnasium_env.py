"""`gymnasium.make("cruise/Race-v0")`: one learner against chosen opponents."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import ArrayLike

from cruise.adapters.options import RaceOptions
from cruise.adapters.races import Races, StandingStart, Stepped
from cruise.adapters.rendering import Screen
from cruise.adapters.spaces import action_box, keys_to_action, observation_box
from cruise.errors import CruiseError

RENDER_MODES = ("rgb_array", "human", "ansi")


class Limited:
    """An environment whose `spec` knows its time limit, whoever made it: wrappers read it there."""

    _races: Races
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What `gymnasium.make` made it from, or None."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and spec.max_episode_steps is None:
            spec.max_episode_steps = self._races.choices.limit
        self._spec = spec


class RaceEnv(Limited, gymnasium.Env[np.ndarray, np.ndarray]):
    """One drone learns, the others are flown by pilots. `docs/gymnasium.md` describes spaces, rewards and information.

    An episode is terminated when the learner has crashed or finished, truncated when the time is over.
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # noqa: RUF012  (as the base class has it)

    def __init__(self, options: RaceOptions | None = None, *, render_mode: str | None = None, **changes: Any) -> None:
        """Settle what is raced; it is built, and JAX started, at the first reset.

        Args:
            options: what is raced; see `RaceOptions`.
            render_mode: `rgb_array`, `human`, `ansi` or None.
            changes: single options, such as `track="ring"` or `opponents=["ring-2"]`.

        Raises:
            CruiseError: the options do not go together.
        """
        if render_mode not in (None, *RENDER_MODES):
            raise CruiseError(f"unknown render_mode {render_mode!r}; there are {', '.join(RENDER_MODES)}")
        self.options = (options or RaceOptions()).changed(changes)
        self._races = Races(self.options, False, 1, "disabled")
        choices = self._races.choices
        self.metadata = self.metadata | {"render_fps": round(1 / choices.vehicle.control_dt)}
        self.render_mode = render_mode
        self.observation_space = observation_box(choices)
        self.action_space = action_box(choices)
        self._screen = Screen(self._races)
        self._begun = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Start a race.

        Args:
            seed: the same seed starts the same race. By default the races go on from the last seed.
            options: `start` may hold `position_w` [N, 3] and `gate`: where the drones, the learner first, stand.

        Returns:
            What the learner sees [O], and information.
        """
        super().reset(seed=seed)
        if seed is None and not self._begun:
            seed = int(self.np_random.integers(2**32))
        self._begun = True
        seen = self._races.reset(None if seed is None else [seed], start=start_of(options))
        self._screen.begin()
        self._after(seen)
        return seen.observation[0, 0], single(seen.info)

    def step(self, action: ArrayLike) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Fly one control step.

        Args:
            action: [A] in [-1, 1], in the frame of the observation.

        Returns:
            Observation [O], reward, terminated, truncated, information.

        Raises:
            CruiseError: the action has another shape or is not finite, or an opponent in Python fails.
        """
        given = np.asarray(action)
        if given.shape != self.action_space.shape:
            raise CruiseError(f"action has shape {list(given.shape)}, expected {list(self.action_space.shape or ())}")
        seen = self._races.step(given[None, None])
        self._after(seen)
        ended = bool(seen.terminated[0, 0]), bool(seen.truncated[0, 0])
        return seen.observation[0, 0], float(seen.reward[0, 0]), *ended, single(seen.info)

    def render(self) -> Any:
        """A picture [H, W, 3] for `rgb_array`, text for `ansi`; a window is drawn by `step` and `reset`."""
        if self.render_mode is None:
            gymnasium.logger.warn(
                'render() needs a render_mode: gymnasium.make("cruise/Race-v0", render_mode="rgb_array")'
            )
            return None
        if self.render_mode == "human":
            return None
        return self._screen.shown(self.render_mode, 0)

    def get_keys_to_action(self) -> dict[tuple[str, ...], np.ndarray]:
        """Full deflection by key, for `gymnasium.utils.play`: w s a d, and r f for the rest."""
        return keys_to_action(self._races.choices)

    def close(self) -> None:
        """Close the window, if there is one."""
        self._screen.close()

    def _after(self, seen: Stepped) -> None:
        if self.render_mode is None:
            return
        self._screen.follow()
        if self.render_mode == "human":
            self._screen.show(0)


def start_of(options: dict[str, Any] | None) -> StandingStart | None:
    """The start that a reset's options ask for. Raises CruiseError where it lacks something."""
    start = (options or {}).get("start")
    if start is None:
        return None
    if not isinstance(start, dict) or set(start) != {"position_w", "gate"}:
        raise CruiseError("options['start'] must be a dictionary with 'position_w' and 'gate'")
    return StandingStart(start["position_w"], start["gate"])


def single(info: dict[str, Any], drone: int = 0) -> dict[str, Any]:
    """Information of a learner of the only race, as NumPy's scalars."""
    return {name: value[0, drone] for name, value in info.items()}
