"""The compiled step of a batch of races with learners, opponents and auto-reset."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.env.race_env import RaceEnv
from cruise.env.surroundings import perceive
from cruise.env.types import RaceState, Rules, StepOutcome
from cruise.pilots.base import Crew
from cruise.racing.events import COLLISION_KINDS
from cruise.racing.grid import Start
from cruise.rollout import act_together, first_memories
from cruise.vector import norm

Reset = Literal["next_step", "same_step", "disabled"]
Seen = dict[str, Any]  # fields of `cruise.adapters.races.Stepped`
Info = dict[str, Any]  # arrays [E, L], or dictionaries of such


class Plan(NamedTuple):
    """What is settled when the step is compiled."""

    env: RaceEnv
    groups: tuple[Crew, ...]  # the learners' first, which is commanded
    learners: tuple[int, ...]
    observation: str
    mode: Reset
    limit: Array  # of an episode, in control steps; traced, so that another one compiles nothing


class Carry(NamedTuple):
    """What goes from step to step."""

    state: RaceState
    memories: tuple
    keys: Array  # [E] every race's own randomness
    pending: Bool[Array, "E"]  # begins anew at the next step
    noise: Array  # key of the pilots' randomness


def begin(
    plan: Plan, keys: Array, grid: Start | None, old: Carry | None, mask: Bool[Array, "E"] | None
) -> tuple[Carry, Seen]:
    """All races anew, or those of `mask`, from `grid` or from starts that are drawn."""
    return _compiled_begin(plan._replace(mode="disabled"), keys, grid, old, mask)  # the mode makes no difference


def _begin(
    plan: Plan, keys: Array, grid: Start | None, old: Carry | None, mask: Bool[Array, "E"] | None
) -> tuple[Carry, Seen]:
    keys, state, spare = _draw(plan, keys)
    if grid is not None:
        state = plan.env.begin(grid)
    memories, noise = first_memories(plan.env, plan.groups, state), spare[0]
    if old is not None and mask is not None:
        state, memories, keys = _where(mask, (state, memories, keys), (old.state, old.memories, old.keys))
        noise = old.noise
    nothing = jnp.zeros((state.step.shape[0], len(plan.learners)))
    seen: Seen = {
        "observation": _observed(plan, state),
        "reward": nothing,
        "terminated": nothing > 0,
        "truncated": nothing > 0,
        "active": nothing == 0,
        "over": jnp.zeros(state.step.shape, bool),
        "info": _standing(plan, state),
    }
    return Carry(state, memories, keys, jnp.zeros(state.step.shape, bool), noise), seen


# Compiled without LLVM's optimisations, in half the time: it runs once, and where single races are reset.
_compiled_begin: Callable[..., tuple[Carry, Seen]] = eqx.filter_jit(  # type: ignore[call-overload]
    _begin, compiler_options={"xla_backend_optimization_level": 0}
)


@eqx.filter_jit
def fly_step(plan: Plan, rules: Rules, carry: Carry, actions: Float[Array, "E L A"]) -> tuple[Carry, Seen]:
    """One control step of all races; those that end, or ended, begin anew as the plan's mode says."""
    before, learners = carry.state, jnp.array(plan.learners)
    noise, key = jax.random.split(carry.noise)
    memories = (actions.transpose(2, 1, 0), *carry.memories[1:])
    memories, action = act_together(plan.env, plan.groups, memories, before, key)
    state, outcome = plan.env.step(before, jnp.where(before.airborne, action, 0.0), rules)

    active = before.airborne[learners] & ~carry.pending  # where it is pending, the step is the reset
    late = state.step >= plan.limit
    terminated = active & ~state.airborne[learners]
    truncated = active & ~terminated & late
    over = (~state.airborne[learners].any(axis=0) | late) & ~carry.pending
    info = _info(plan, state, outcome, active)
    seen: Seen = {
        "reward": jnp.where(active, outcome.reward[learners], 0.0).T,
        "terminated": terminated.T,
        "truncated": truncated.T,
        "active": active.T,
        "over": over,
    }
    if plan.mode == "same_step":
        seen |= {"final_observation": _observed(plan, state), "final_info": info}
    restart = {"next_step": carry.pending, "same_step": over, "disabled": None}[plan.mode]
    keys = carry.keys
    if restart is not None:
        state, memories, keys = _restarted(plan, restart, (state, memories, keys))
        info = _where(restart[:, None], _standing(plan, state), info)
    pending = over if plan.mode == "next_step" else carry.pending
    return Carry(state, memories, keys, pending, noise), seen | {"observation": _observed(plan, state), "info": info}


def _draw(plan: Plan, keys: Array) -> tuple[Array, RaceState, Array]:
    """Every race's next randomness, its start, drawn by itself so that it is the same in any batch, and a spare key."""
    keys, start_keys, spare = jnp.moveaxis(jax.vmap(lambda key: jax.random.split(key, 3))(keys), 1, 0)
    return keys, jax.vmap(plan.env.reset, out_axes=-1)(start_keys), spare


def _restarted(plan: Plan, restart: Bool[Array, "E"], now: tuple) -> tuple:
    """(state, memories, keys) with new starts in some races; nothing is drawn where there is none."""

    def anew(now: tuple) -> tuple:
        keys, state, _ = _draw(plan, now[2])
        fresh: tuple = _where(restart, (state, first_memories(plan.env, plan.groups, state), keys), now)
        return fresh

    return jax.lax.cond(restart.any(), anew, lambda now: now, now)


def _where(mask: Array, new: Any, old: Any) -> Any:
    """Leaves whose last axis, or first two where the mask has two, are those of the mask."""
    return jax.tree.map(lambda a, b: jnp.where(mask, a, b), new, old)


def _observed(plan: Plan, state: RaceState) -> Float[Array, "E L O"]:
    observation = plan.env.observe_as[plan.observation](perceive(state))
    return observation[:, jnp.array(plan.learners)].transpose(2, 1, 0)


def _standing(plan: Plan, state: RaceState) -> Info:
    """The information of a race that has just begun: nothing has happened."""
    shape = (state.step.shape[0], len(plan.learners))
    no, zero = jnp.zeros(shape, bool), jnp.zeros(shape)
    return {
        "time": zero,
        "gates_passed": jnp.zeros(shape, jnp.int32),
        "next_gate": state.next_gate[jnp.array(plan.learners)].T,
        "speed": zero,
        "passed_gate": no,
        "missed_gate": no,
        "finished": no,
        "collision": {kind.hit: no for kind in COLLISION_KINDS},
        "reward_components": dict.fromkeys(plan.env.reward.names, zero),
    }


def _info(plan: Plan, state: RaceState, outcome: StepOutcome, active: Bool[Array, "L E"]) -> Info:
    learners = jnp.array(plan.learners)

    def mine(values: Array) -> Array:
        return values[learners].T

    terms = plan.env.reward.counted(outcome)
    time = (state.step * plan.env.dynamics.control_dt).astype(jnp.float32)
    return {
        "time": jnp.broadcast_to(time[:, None], active.T.shape),
        "gates_passed": mine(state.gates_passed),
        "next_gate": mine(state.next_gate),
        "speed": mine(norm(state.drones.velocity_w)),
        "passed_gate": mine(outcome.crossing.passed) & active.T,
        "missed_gate": mine(outcome.crossing.missed) & active.T,
        "finished": mine(state.finished),
        "collision": {hit: mine(met) & active.T for hit, met in outcome.collisions._asdict().items()},
        "reward_components": {name: jnp.where(active.T, mine(value), 0.0) for name, value in terms.items()},
    }
