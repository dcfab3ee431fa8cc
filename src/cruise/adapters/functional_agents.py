"""The functional races one at a time, for `jax.vmap`: agents by name as JaxMARL has them, or one as gymnax has it."""

from typing import Any, Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array

from cruise.adapters.compiled import Carry
from cruise.adapters.functional import Box, FunctionalRaces, typed
from cruise.adapters.options import RaceOptions
from cruise.adapters.per_race import of_one_race
from cruise.config import Track
from cruise.errors import CruiseError
from cruise.evaluation.race_choices import FleetChoice
from cruise.precision import single_precision

Layout = Literal["races-last", "agents", "single"]
Values = dict[str, Any]  # by agent


class AgentRaces(FunctionalRaces):
    """One race of agents `drone_0`, `drone_1` ..., with the interface of JaxMARL's `MultiAgentEnv`.

    `jax.vmap` of `reset` and `step` flies many, races last inside; turning the arrays costs time at every step. An
    agent that is out stays done until the race ends (`dones["__all__"]`) and begins anew in the same step. `info` holds
    arrays [N] by name, `terminated`, `truncated` and `active` among them, and `final_observation` [N, O], what was seen
    before a new race began.
    """

    def __init__(self, options: RaceOptions) -> None:
        """See `cruise.make`."""
        super().__init__(options)
        self.observation_spaces: dict[str, Box] = dict.fromkeys(self.agents, self.observation_space())
        self.action_spaces: dict[str, Box] = dict.fromkeys(self.agents, self.action_space())
        self._reset_one, self._step_one = of_one_race(self._reset), of_one_race(self._step_of_each)

    @single_precision
    def reset(self, key: Array, params: None = None) -> tuple[Any, Carry]:  # type: ignore[override]
        """Begin a race: observations by agent [O], and the state that `step` takes."""
        observation, state = self._reset_one(jax.random.key_data(typed(key)))
        return self._named(observation.T), state

    @single_precision
    def step(self, key: Array, state: Carry, action: Any, params: None = None) -> tuple:
        """Fly one control step.

        Args:
            key: of opponents that draw random numbers. Starts depend on the key of the reset alone.
            state: from `reset` or the last step.
            action: [A] in [-1, 1] by agent; of agents that are out they are not read.
            params: there are none; gymnax's environments take them.

        Returns:
            Observations [O] by agent, the state, rewards and dones by agent, with `dones["__all__"]`, and information.
        """
        seen, state, reward, terminated, truncated, info = self._step_one(
            jax.random.key_data(typed(key)), state, self._together(action)
        )
        over, done = info.pop("over"), info.pop("done")
        info |= {"terminated": terminated, "truncated": truncated, "final_observation": info["final_observation"].T}
        return self._named(seen.T), state, self._named(reward), self._dones(done, over), info

    def _step_of_each(self, keys: Array, state: Carry, action: Array) -> tuple:
        """All races; their pilots draw from the first key."""
        *told, info = self._step(keys[:, 0], state, action)
        return *told, info

    def _together(self, action: Any) -> Array:
        """[A, N]."""
        return jnp.stack([action[agent] for agent in self.agents], axis=-1)

    def _named(self, values: Array) -> Any:
        return dict(zip(self.agents, values, strict=True))

    def _dones(self, done: Array, over: Array) -> Any:
        return self._named(done) | {"__all__": over}


class SingleRace(AgentRaces):
    """One race in which one drone learns, with the interface of gymnax 1.0: a step gives six values.

    Arrays are in place of dictionaries by agent, in the information too: `final_observation` [O].
    """

    def __init__(self, options: RaceOptions) -> None:
        """Raises CruiseError where several drones learn."""
        super().__init__(options)
        if self.num_agents > 1:
            raise CruiseError('layout "single" is for one learner: name opponents, or give drones=1')

    @property
    def default_params(self) -> None:
        """There are none: options are settled by `cruise.make`."""
        return

    def step(self, key: Array, state: Carry, action: Any, params: None = None) -> tuple:
        """Observation [O], the state, reward, terminated, truncated and information; see `AgentRaces.step`."""
        seen, state, reward, _, info = super().step(key, state, action, params)
        info = {name: values[0] for name, values in info.items()}
        return seen, state, reward, info["terminated"], info["truncated"], info

    def _together(self, action: Any) -> Array:
        return jnp.asarray(action)[:, None]

    def _named(self, values: Array) -> Any:
        return values[0]

    def _dones(self, done: Array, over: Array) -> Any:
        return over


LAYOUTS: dict[str, type[FunctionalRaces]] = {
    "races-last": FunctionalRaces,
    "agents": AgentRaces,
    "single": SingleRace,
}


def make(
    track: Track | str = "ring",
    drones: int | None = None,
    vehicle: FleetChoice = "paper",
    *,
    layout: Layout | str = "races-last",
    **options: Any,
) -> FunctionalRaces:
    """The race as pure functions for learning loops in JAX: `env.reset(key, ...)`, `env.step(key, state, action)`.

    Rules, rewards, opponents, frames, the time limit and new episodes are the environment's.

    Args:
        track: a track, the name of a built-in one, or the path of a TOML file.
        drones: in a race; by default one more than opponents are named, or 4.
        vehicle: a vehicle, the name of a built-in one, or the path of a TOML file; or several, one per drone.
        layout: `races-last`: many races in arrays [components, drones, races], the fastest. `agents`: one race with
            agents by name, for `jax.vmap`, as JaxMARL's. `single`: one race with one learner, for `jax.vmap`, as
            gymnax's since 1.0.
        options: the others of `cruise.adapters.options.RaceOptions`. Without `opponents` every drone learns; with
            them drone 0 does. Pilots in plain Python cannot fly here.

    Raises:
        CruiseError: the options do not go together.
    """
    if layout not in LAYOUTS:
        raise CruiseError(f"unknown layout {layout!r}; there are {', '.join(LAYOUTS)}")
    return LAYOUTS[layout](RaceOptions().changed({"track": track, "drones": drones, "vehicle": vehicle} | options))
