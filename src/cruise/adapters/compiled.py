"""The step of a batch of races with learners, opponents and auto-reset: components first, races last."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Shaped, UInt32

from cruise.env.race_env import RaceEnv
from cruise.env.surroundings import perceive
from cruise.env.types import RaceState, Rules, StepOutcome
from cruise.evaluation.matches import STREAM
from cruise.pilots.base import Crew
from cruise.racing.events import COLLISION_KINDS
from cruise.racing.field import rows
from cruise.racing.grid import Start
from cruise.rollout import act_together, first_memories
from cruise.vector import norm

Reset = Literal["next_step", "same_step", "disabled"]
Seen = dict[str, Any]  # fields of `cruise.adapters.races.Stepped`, races last
Info = dict[str, Array]  # [L, E] each


class Plan(NamedTuple):
    """What is settled when the step is compiled."""

    env: RaceEnv
    groups: tuple[Crew, ...]
    commanded: int  # of them: the first ones, the learners'
    learners: tuple[int, ...]
    observation: str
    mode: Reset
    limit: Array  # of an episode, in control steps; traced, so that another one compiles nothing
    race: bool = False  # the race of a seed is that of `cruise.race`
    spread: float = 0.0  # share of starts all along the track


class Begun(NamedTuple):
    """Races at their start, and what their pilots remember there."""

    state: RaceState
    memories: tuple  # the opponents'


class Carry(NamedTuple):
    """What goes from step to step."""

    state: RaceState
    memories: tuple  # the opponents'
    keys: UInt32[Array, "K E"]  # every race's own randomness, the data of a key
    pending: Bool[Array, "E"]  # begins anew at the next step
    noise: UInt32[Array, "K"] | None  # of the pilots; None where every step is given its own
    following: Begun | None = None  # where each race begins next; None where races are begun by a reset alone
    used: Bool[Array, "E"] | None = None  # it has begun there already


def begin(
    plan: Plan, keys: UInt32[Array, "K E"], grid: Start | None, old: Carry | None, mask: Bool[Array, "E"] | None
) -> tuple[Carry, Seen]:
    """All races anew, or those of `mask`, from `grid` or from starts that are drawn."""
    drawn, begun, spare = _draw(plan, keys, grid)
    noise: Array | None = spare[:, 0]
    if old is not None and mask is not None:
        begun, drawn = _where(mask, (begun, drawn), (Begun(old.state, old.memories), old.keys))
        noise = old.noise
    no = jnp.zeros(begun.state.step.shape, bool)
    nothing = jnp.zeros((len(plan.learners), *no.shape))
    seen: Seen = {
        "observation": observed(plan, begun.state),
        "reward": nothing,
        "terminated": nothing > 0,
        "truncated": nothing > 0,
        "active": nothing == 0,
        "over": no,
        "info": _standing(plan, begun.state),
    }
    carry = Carry(*begun, keys=drawn, pending=no, noise=noise)
    return carry if plan.mode == "disabled" else carry._replace(following=begun, used=~no), seen


def fly(plan: Plan, rules: Rules, carry: Carry, actions: Float[Array, "A L E"]) -> tuple[Carry, Seen]:
    """One control step of all races, none of which begins anew."""
    before = carry.state
    assert carry.noise is not None
    noise, key = jax.random.split(jax.random.wrap_key_data(carry.noise))
    told = (*_commands(plan, actions), *carry.memories)
    remembered, action = act_together(plan.env, plan.groups, told, before, key)
    state, outcome = plan.env.step(before, jnp.where(before.airborne, action, 0.0), rules)
    racing = _of_learners(plan, state.airborne)
    active = _of_learners(plan, before.airborne) & ~carry.pending  # where it is pending, the step is the reset
    late = state.step >= plan.limit
    terminated = active & ~racing
    seen: Seen = {
        "reward": jnp.where(active, _of_learners(plan, outcome.reward), 0.0),
        "terminated": terminated,
        "truncated": active & ~terminated & late,
        "active": active,
        "over": (~racing.any(axis=0) | late) & ~carry.pending,
        "info": _info(plan, state, outcome, active),
    }
    return carry._replace(state=state, memories=remembered[plan.commanded :], noise=jax.random.key_data(noise)), seen


def step(plan: Plan, rules: Rules, carry: Carry, actions: Float[Array, "A L E"]) -> tuple[Carry, Seen]:
    """One control step of all races; those that end, or ended, begin anew as the plan's mode says."""
    pending = carry.pending
    carry, seen = fly(plan, rules, carry, actions)
    if plan.mode == "same_step":
        seen |= {"final_observation": observed(plan, carry.state), "final_info": seen["info"]}
    restart = {"next_step": pending, "same_step": seen["over"], "disabled": None}[plan.mode]
    if restart is not None:
        carry = begin_again(plan, restart, carry)
        seen["info"] = _where(restart, _standing(plan, carry.state), seen["info"])
    if plan.mode == "next_step":
        carry = carry._replace(pending=seen["over"])
    return carry, seen | {"observation": observed(plan, carry.state)}


def begin_again(plan: Plan, restart: Bool[Array, "E"], carry: Carry) -> Carry:
    """New starts in some races.

    Starts of all races are drawn at once, ahead, and only where one would have to serve twice: drawing them at every
    step would cost more than flying. Each race draws by itself, so that its starts are the same in any batch.
    """
    assert carry.following is not None
    assert carry.used is not None
    used = carry.used

    def anew(now: tuple) -> tuple:
        keys, begun, _ = _draw(plan, carry.keys)
        fresh: tuple = _where(used, (keys, begun, jnp.zeros_like(used)), now)
        return fresh

    now = (carry.keys, carry.following, used)
    keys, following, used = jax.lax.cond((restart & used).any(), anew, lambda now: now, now)
    state, memories = _where(restart, following, Begun(carry.state, carry.memories))
    return carry._replace(state=state, memories=memories, keys=keys, following=following, used=used | restart)


def observed(plan: Plan, state: RaceState) -> Float[Array, "O L E"]:
    """What the learners see."""
    return rows(plan.env.observe_as[plan.observation](perceive(state)), plan.learners, axis=1)


def _draw(plan: Plan, keys: UInt32[Array, "K E"], grid: Start | None = None) -> tuple[Array, Begun, Array]:
    """Every race's next randomness, its start, drawn by itself so that it is the same in any batch, and a spare key.

    A race that `cruise.race` flies, too, starts by the first of the keys, as it does there.
    """
    split = jax.vmap(lambda key: jax.random.split(key, 3))(jax.random.wrap_key_data(keys.T))
    start, following = (split[:, i] for i in ((0, 1) if plan.race else (1, 0)))

    def reset(key: Array, at: Start | None) -> RaceState:
        return plan.env.reset(key, spread=plan.spread, start=at)

    state = jax.vmap(reset, in_axes=(0, -1), out_axes=-1)(start, grid)
    following, spare = (jax.random.key_data(one).T for one in (following, split[:, 2]))
    return following, Begun(state, _remembered(plan, state)), spare


def key_of(race: bool, seed: Array, high: Array | int = 0) -> Array:
    """The key of the race of a seed of 32 bits and 32 higher ones; of a real race, of that in `cruise.race`."""
    key = jax.random.key(seed)
    return jax.random.fold_in(jax.random.fold_in(key, STREAM) if race else key, high)


def _commands(plan: Plan, actions: Float[Array, "A L E"]) -> tuple[Array, ...]:
    """The learners' actions, vehicle by vehicle; of the widest action each takes the numbers that it has."""
    crews = plan.groups[: plan.commanded]
    sizes = [plan.env.of_drones(crew.drones).dynamics.action_size for crew in crews]
    return tuple(rows(actions[:size], crew.drones, axis=1) for size, crew in zip(sizes, crews, strict=True))


def _remembered(plan: Plan, state: RaceState) -> tuple:
    """What opponents remember at the start; learners are commanded, which leaves nothing to remember."""
    return first_memories(plan.env, plan.groups[plan.commanded :], state)


def _where(mask: Array, new: Any, old: Any) -> Any:
    """Leaves, whose last axis is the races, are those of the mask."""
    return jax.tree.map(lambda a, b: jnp.where(mask, a, b), new, old)


def _standing(plan: Plan, state: RaceState) -> Info:
    """The information of a race that has just begun: nothing has happened."""
    shape = (len(plan.learners), *state.step.shape)
    no, zero = jnp.zeros(shape, bool), jnp.zeros(shape)
    return {
        "time": zero,
        "gates_passed": jnp.zeros(shape, jnp.int32),
        "next_gate": _of_learners(plan, state.next_gate),
        "speed": zero,
        "passed_gate": no,
        "missed_gate": no,
        "finished": no,
        **{f"collision_{kind.hit}": no for kind in COLLISION_KINDS},
        **{f"reward_{name}": zero for name in plan.env.reward.names},
    }


def _of_learners(plan: Plan, values: Shaped[Array, "N E"]) -> Shaped[Array, "L E"]:
    return rows(values, plan.learners, axis=0)


def _info(plan: Plan, state: RaceState, outcome: StepOutcome, active: Bool[Array, "L E"]) -> Info:

    def mine(values: Array) -> Array:
        return _of_learners(plan, values)

    terms = plan.env.reward.counted(outcome)
    time = (state.step * plan.env.dynamics.control_dt).astype(jnp.float32)
    return {
        "time": jnp.broadcast_to(time, active.shape),
        "gates_passed": mine(state.gates_passed),
        "next_gate": mine(state.next_gate),
        "speed": mine(norm(state.drones.velocity_w)),
        "passed_gate": mine(outcome.crossing.passed) & active,
        "missed_gate": mine(outcome.crossing.missed) & active,
        "finished": mine(state.finished),
        **{f"collision_{hit}": mine(met) & active for hit, met in outcome.collisions._asdict().items()},
        **{f"reward_{name}": jnp.where(active, mine(value), 0.0) for name, value in terms.items()},
    }


def _races_first(seen: Seen) -> Seen:
    """[O, L, E], [L, E] and [E] to [E, L, O], [E, L] and [E]."""
    return jax.tree.map(jnp.transpose, seen)


@eqx.filter_jit
def fly_step(plan: Plan, rules: Rules, carry: Carry, actions: Float[Array, "E L A"]) -> tuple[Carry, Seen]:
    """`step` for arrays whose races are first."""
    carry, seen = step(plan, rules, carry, actions.T)
    return carry, _races_first(seen)


def _begin_first(plan: Plan, *rest: Any) -> tuple[Carry, Seen]:
    carry, seen = begin(plan, *rest)
    return carry, _races_first(seen)


# Compiled without LLVM's optimisations, in half the time: it runs once, and where single races are reset.
begin_first: Callable[..., tuple[Carry, Seen]] = eqx.filter_jit(  # type: ignore[call-overload]
    _begin_first, compiler_options={"xla_backend_optimization_level": 0}
)
