"""Pilots out of a pool, another line-up in every race, in one compiled program."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from cruise.config import Vehicle
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.errors import CruiseError
from cruise.pilots.base import Memory, Pilot


class Pool(eqx.Module):
    """Drone i of race e is flown by member `chosen[i, e]`. All members think, for every drone: a pool is small."""

    members: tuple[Pilot, ...]
    chosen: Int[Array, "N *B"]
    name: str = eqx.field(static=True, default="pool")

    @property
    def agility(self) -> float:
        """That of all. Raises CruiseError where they differ."""
        scales = {member.agility for member in self.members}
        if len(scales) > 1:
            raise CruiseError(f"pilots of a pool must have one scale of their actions, not {sorted(scales)}")
        return scales.pop()

    @property
    def vehicle(self) -> str | Vehicle:
        """That of the first."""
        return self.members[0].vehicle

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """Everyone's memory of every drone."""
        return tuple(member.init(env, drones, state) for member in self.members)

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """The action of each drone's own pilot."""
        keys = [jax.random.fold_in(key, number) for number in range(len(self.members))]
        said = [
            member.act(env, drones, before, state, one)
            for member, before, one in zip(self.members, memory, keys, strict=True)
        ]
        who, action = self.chosen[jnp.array(drones)], said[0][1]
        for number, (_, asked) in enumerate(said[1:], start=1):
            action = jnp.where(who == number, asked, action)
        return tuple(after for after, _ in said), action
