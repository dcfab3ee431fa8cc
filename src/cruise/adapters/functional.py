"""`cruise.make(...)`: the race as pure functions that JAX compiles, differentiates and shards."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.adapters.compiled import Carry, begin, begin_again, fly, key_of, observed
from cruise.adapters.options import RaceOptions, choose
from cruise.adapters.setup import set_up
from cruise.errors import CruiseError
from cruise.precision import single_precision
from cruise.racing.field import rows


class Box(NamedTuple):
    """A space of vectors of float32 with the attributes that gymnax, JaxMARL and Gymnasium give theirs."""

    low: Float[Array, "S"]
    high: Float[Array, "S"]
    dtype: Any = jnp.float32

    @property
    def shape(self) -> tuple[int, ...]:
        """[S]."""
        return self.low.shape

    def sample(self, key: Array) -> Float[Array, "S"]:
        """A point of it, uniformly."""
        return jax.random.uniform(key, self.shape, self.dtype, self.low, self.high)

    def contains(self, x: Array) -> Array:
        """Whether a point lies in it."""
        return jnp.all((x >= self.low) & (x <= self.high))


class FunctionalRaces:
    """Races as pure functions: components first, then the L drones that learn, then the E races.

    A race that ends begins anew in the same step; `info["final_observation"]` is what was seen before. Drones that are
    out stay in the arrays until their race ends: `info["active"]` says who flew the step.
    """

    @single_precision
    def __init__(self, options: RaceOptions) -> None:
        """Build the race: see `cruise.make`."""
        self.options = options
        self._choices = choose(options, everybody_learns=options.opponents is None)
        setup = set_up(self._choices, "same_step")
        if setup.python_pilots:
            raise CruiseError("a pilot in plain Python cannot fly in a compiled program: take it in cruise/Race-v0")
        self._plan, self._rules = setup.plan, setup.rules
        self.agents = [f"drone_{drone}" for drone in self._choices.learners]
        self.num_agents = len(self.agents)
        entries = self._choices.layout
        low, high = ([getattr(e, end) for e in entries for _ in range(e.size)] for end in ("low", "high"))
        self._observation = Box(jnp.array(low, jnp.float32), jnp.array(high, jnp.float32))
        ones = jnp.ones(self._choices.action.size, jnp.float32)
        self._action = Box(-ones, ones)

    @property
    def name(self) -> str:
        """As Gymnasium calls it."""
        return "cruise/Race-v0"

    @property
    def control_dt(self) -> float:
        """Between two steps [s]."""
        return self._choices.vehicle.control_dt

    @property
    def episode_steps(self) -> int:
        """Time limit of an episode, at which it is truncated [control steps]."""
        return self._choices.limit

    @property
    def layout(self) -> tuple:
        """What the numbers of an observation are, in their order."""
        return self._choices.layout

    def observation_space(self, agent: Any = None) -> Box:
        """[O], the same for every agent; bounds are those that the numbers are clipped to."""
        return self._observation

    def action_space(self, agent: Any = None) -> Box:
        """[A] in [-1, 1], in the frame of the observation, the same for every agent."""
        return self._action

    def key_of(self, seed: Array | int) -> Array:
        """The key of a seed's race, below 2^32, in Gymnasium and PettingZoo; of a real race in `cruise.race`, too."""
        return key_of(self._plan.race, jnp.asarray(seed, jnp.uint32))

    @single_precision
    def reset(self, key: Array, races: int | None = None) -> tuple[Float[Array, "O L E"], Carry]:
        """Begin so many races.

        Args:
            key: one, which is split, or a key for every race: with those of `key_of` the races of seeds elsewhere.
            races: their number E, where there is one key.

        Returns:
            Observations [O, L, E], and the state that `step` takes.
        """
        keys = typed(key) if races is None else jax.random.split(typed(key), races)
        return self._reset(jax.random.key_data(keys).T)

    @single_precision
    def step(
        self, key: Array, state: Carry, action: Float[Array, "A L E"]
    ) -> tuple[Float[Array, "O L E"], Carry, Array, Array, Array, dict[str, Any]]:
        """Fly one control step; races that end begin anew.

        Args:
            key: of opponents that draw random numbers. Starts depend on the key of the reset alone.
            state: from `reset` or the last step.
            action: [A, L, E] in [-1, 1], in the frame of the observation; clipped.

        Returns:
            Observations to act on next, the state, rewards [L, E], who crashed or finished in this step (terminated)
            and who was racing when the time was over (truncated) [L, E], and information of the step [L, E], with
            `active` and `done` (out, or over) [L, E], `over` [E] and `final_observation` [O, L, E]. What is not used
            costs nothing when compiled.
        """
        return self._step(jax.random.key_data(typed(key)), state, action)

    # Compiled for callers that do not compile: their first reset would compile its operations one by one.
    @functools.partial(jax.jit, static_argnums=0)
    def _reset(self, keys: Array) -> tuple[Array, Carry]:
        state, seen = begin(self._plan, keys, None, None, None)
        return seen["observation"], state._replace(noise=None)

    @functools.partial(jax.jit, static_argnums=0)
    def _step(self, noise: Array, state: Carry, action: Array) -> tuple[Array, Carry, Array, Array, Array, Any]:
        state, seen = fly(self._plan, self._rules, state._replace(noise=noise), action)
        info = seen["info"] | {name: seen[name] for name in ("active", "over")}
        info["done"] = ~rows(state.state.airborne, self._plan.learners, axis=0) | seen["over"]
        info["final_observation"] = observed(self._plan, state.state)
        state = begin_again(self._plan, seen["over"], state._replace(noise=None))
        told = observed(self._plan, state.state)
        return told, state, seen["reward"], seen["terminated"], seen["truncated"], info


def typed(key: Array) -> Array:
    """A key, where an array of its data was given."""
    return key if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else jax.random.wrap_key_data(key)
