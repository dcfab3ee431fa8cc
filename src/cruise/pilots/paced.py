"""Any compiled pilot, made slower: champions that a person can race."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Vehicle
from cruise.dynamics import DroneState, Reference
from cruise.env.mixed import padded
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState, race_rules
from cruise.pilots.base import Memory, Pilot
from cruise.racing.field import rows


class Ahead(NamedTuple):
    """A race that the pilot flies in its own time, between two steps of which its drones follow."""

    memory: Memory  # of the pilot
    before: RaceState
    after: RaceState
    phase: Float[Array, "*B"]  # how far between the two, in [0, 1)


class Paced(eqx.Module):
    """Flies the way of another pilot in `1 / pace` of its time.

    The pilot flies a race of its own, whose clock runs `pace` times as fast as that of the real one and in which the
    other drones are where they really are. The real drone follows that flight x(s), s = pace t, by position, velocity
    pace x' and acceleration pace^2 x'': the same equations of motion, the same thrust.
    """

    pilot: Pilot
    pace: float = eqx.field(static=True)  # above 0, at most 1

    @property
    def name(self) -> str:
        """That of the pilot."""
        return self.pilot.name

    @property
    def agility(self) -> float:
        """That of the pilot."""
        return self.pilot.agility

    @property
    def vehicle(self) -> str | Vehicle:
        """That of the pilot."""
        return self.pilot.vehicle

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """Both races begin alike."""
        phase = jnp.full(state.step.shape, 1.0 - self.pace, jnp.float32)
        return Ahead(self.pilot.init(env, drones, state), state, state, phase)

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """Let the pilot fly on where its time has come, and follow it."""
        ahead: Ahead = memory
        phase = ahead.phase + self.pace
        due = phase >= 1
        own, after = self._fly_on(env, drones, ahead, state, key)
        own = _where(due, own, ahead.memory)
        before = _where(due, ahead.after, ahead.before)
        after = _where(due, after, ahead.after)
        phase = jnp.where(due, phase - 1, phase)
        reference = self._reference(env, before.drones, after.drones, phase)
        action = env.dynamics.track(state.drones, reference, self.agility)
        return Ahead(own, before, after, phase), rows(action, drones, axis=1)

    def _fly_on(
        self, env: RaceEnv, drones: tuple[int, ...], ahead: Ahead, state: RaceState, key: Array
    ) -> tuple[Memory, RaceState]:
        """One step of the pilot's race, among the others as they really are."""
        race = _among(env, ahead.after, self._in_its_time(state), drones)
        own, action = self.pilot.act(env, drones, ahead.memory, race, key)
        action = padded(action, max(group.dynamics.action_size for group in env.groups))
        everybody = jnp.zeros((action.shape[0], env.num_drones, *action.shape[2:]), action.dtype)
        rules = jax.tree.map(jnp.asarray, race_rules(self.agility, 0.0, 0))
        after, _ = env.step(race, everybody.at[:, jnp.array(drones)].set(action), rules)
        return own, after

    def _in_its_time(self, state: RaceState) -> RaceState:
        body = state.drones.body
        body = body._replace(velocity_w=body.velocity_w / self.pace)
        return state._replace(drones=state.drones._replace(body=body))

    def _reference(self, env: RaceEnv, before: DroneState, after: DroneState, phase: Array) -> Reference:
        """The pilot's flight at `phase`, a cubic through both steps, in the time of the real race."""
        dt = env.dynamics.control_dt
        (p0, v0), (p1, v1) = ((d.position_w, dt * d.velocity_w) for d in (before, after))
        s, rest = phase, 1 - phase
        position = rest * rest * ((1 + 2 * s) * p0 + s * v0) + s * s * ((3 - 2 * s) * p1 - rest * v1)
        return Reference(
            position_w=position,
            velocity_w=self.pace * (rest * before.velocity_w + s * after.velocity_w),
            acceleration_w=self.pace**2 * (after.velocity_w - before.velocity_w) / dt,
            heading=env.dynamics.euler(after)[2],
        )


def _among(env: RaceEnv, own: RaceState, others: RaceState, drones: tuple[int, ...]) -> RaceState:
    """The pilot's race with all drones but its own as in another one."""
    mine = jnp.isin(jnp.arange(env.num_drones), jnp.array(drones)).reshape(-1, *(1,) * (own.next_gate.ndim - 1))
    here, there = own.drones, others.drones
    if len(env.groups) == 1:
        memory = _where(mine, here.memory, there.memory)
    else:  # of the drones of each vehicle by themselves
        each = zip(env.groups, here.memory, there.memory, strict=True)
        memory = tuple(_where(mine[jnp.array(group.drones)], a, b) for group, a, b in each)
    body, parameters = (_where(mine, getattr(here, of), getattr(there, of)) for of in ("body", "parameters"))
    rest = ("next_gate", "gates_passed", "out", "finished")
    mixed = {name: _where(mine, getattr(own, name), getattr(others, name)) for name in rest}
    return own._replace(drones=here._replace(body=body, memory=memory, parameters=parameters), **mixed)


def _where(chosen: Array, one: Any, other: Any) -> Any:
    """One where that is chosen, the other elsewhere."""
    return jax.tree.map(lambda a, b: jnp.where(chosen, a, b), one, other)
