"""A trained policy as a pilot."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import ObservationKind, Vehicle
from cruise.env.observation import check_observation, for_any_field
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.errors import CruiseError
from cruise.pilots.base import Memory
from cruise.pilots.network import ActorCritic
from cruise.racing.field import rows
from cruise.terms import Entry, difference


class NeuralPilot(eqx.Module):
    """Flies by the mean action of an actor network, turned into the vehicle's frame and clipped to [-1, 1].

    A policy knows its number of drones, because the size of what it sees depends on it, unless it sees by `body`.
    """

    params: ActorCritic
    observation: ObservationKind = eqx.field(static=True)
    drones: int = eqx.field(static=True)  # in the races it was trained for
    agility: float = eqx.field(static=True)
    name: str = eqx.field(static=True)
    vehicle: str | Vehicle = eqx.field(static=True, default="paper")
    layout: tuple[Entry, ...] = eqx.field(static=True, default=())  # of its observation; () where nobody wrote it down

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """What the network remembers before the start. Raises CruiseError where the policy does not fit the race."""
        check_observation(f"policy {self.name!r}", self.observation)
        if not for_any_field(self.observation) and self.drones != env.num_drones:
            raise CruiseError(
                f"policy {self.name!r} was trained for races of {self.drones} drones, this race has {env.num_drones}"
            )
        seen = jax.eval_shape(env.observe_as[self.observation], state).shape[0]
        takes, gives = self.params.shape.observation_size, self.params.shape.action_size
        if takes != seen:
            raise CruiseError(
                f"policy {self.name!r} reads {takes} numbers, but the {self.observation!r} observation has {seen} in "
                f"this race of {env.num_drones} drones and {env.course.num_gates} gates"
            )
        other = difference(self.layout, env.layout(self.observation)) if self.layout else None
        if other:
            raise CruiseError(f"policy {self.name!r} was trained on another observation {self.observation!r}: {other}")
        if gives != env.dynamics.action_size:
            raise CruiseError(
                f"policy {self.name!r} gives {gives} numbers, but this vehicle's action has {env.dynamics.action_size}"
            )
        return self.params.init_carry((len(drones), *state.step.shape))

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """The deterministic action for each of its drones."""
        del key
        observation = rows(env.observe_as[self.observation](state), drones, axis=1)
        memory, action = self.params.apply(memory, observation)
        action = env.decode_as[self.observation](state, action, drones)
        return memory, jnp.clip(action, -1.0, 1.0)
