"""The league: past policies, founders among them, as opponents beside the newest.

Half of all races are flown against the newest opponents, as in the paper's self-play; the others against `SLOTS`
members of the league, each in an equal share of them. After every evaluation members are drawn anew by prioritised
fictitious self-play (Vinyals et al., Nature 2019): the less often the active policy beats one, the more likely it is to
fly. A policy joins when the opponents are replaced; when no place is free, the one that is beaten most often leaves.
Founders stay: exploiters, trained with `--against`, teach the league what they found.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from cruise.pilots.network import ActorCritic, Carry
from cruise.training.types import ACTIVE, League, OpponentPool, TrainState

SLOTS = 4  # members that fly at a time
SHARES = 2 * SLOTS  # race number e belongs to share e modulo SHARES: the first half of them meets the newest opponents
UNKNOWN = 0.5  # how often a member that nobody has met is beaten
MEMORY = 0.7  # of what was known before an evaluation
LEAST_WEIGHT = 0.01  # of a member that is always beaten
ELO_START, ELO_GAIN, ELO_SCALE = 1000.0, 32.0, 400.0


def found_league(model: ActorCritic, places: int, founders: Sequence[ActorCritic] = ()) -> League:
    """A league of `founders`, or of `model` alone where there are none."""
    first = list(founders) or [model]
    rows = first + [model] * (places - len(first))
    members: ActorCritic = jax.tree.map(lambda *leaves: jnp.stack(leaves), *rows)
    taken = jnp.arange(places) < len(first)
    return League(
        members=members,
        joined=jnp.where(taken, 0, -1),
        beaten=jnp.full(places, UNKNOWN),
        rating=jnp.full(places, ELO_START),
        own_rating=jnp.asarray(ELO_START),
        flying=jnp.arange(SLOTS) % len(first),
    )


def opponents_fly(
    pool: OpponentPool, league: League | None, carry: Carry, observation: Float[Array, "O K E"]
) -> tuple[Carry, Float[Array, "A K E"]]:
    """What the frozen drones remember [H K E], and their deterministic actions."""
    if league is None:
        return newest_fly(pool, carry, observation)
    given = jax.tree.map(lambda x: x.reshape(*x.shape[:-1], -1, SHARES), (carry, observation))
    older = pool.uses_previous.reshape(-1, SHARES)[:, :SLOTS]
    newest = newest_fly(pool._replace(uses_previous=older), *jax.tree.map(lambda x: x[..., :SLOTS], given))
    members = members_fly(league, *jax.tree.map(lambda x: x[..., SLOTS:], given))
    flown: tuple[Carry, Array] = jax.tree.map(
        lambda a, b: jnp.concatenate([a, b], axis=-1).reshape(-1, *observation.shape[1:]), newest, members
    )
    return flown


def newest_fly(
    pool: OpponentPool, carry: Carry, observation: Float[Array, "O K *E"]
) -> tuple[Carry, Float[Array, "A K *E"]]:
    """The same of the newest opponents; the older generation costs only while a race still uses it.

    Each race is flown by one generation from its start to its end, whose memory is the one it has.
    """
    newest = pool.newest.apply(carry, observation)

    def mixed(_: None) -> tuple[Carry, Array]:
        previous = pool.previous.apply(carry, observation)
        chosen: tuple[Carry, Array] = jax.tree.map(
            lambda older, newer: jnp.where(pool.uses_previous, older, newer), previous, newest
        )
        return chosen

    return jax.lax.cond(pool.uses_previous.any(), mixed, lambda _: newest, None)


def members_fly(
    league: League, carry: Carry, observation: Float[Array, "O K E S"]
) -> tuple[Carry, Float[Array, "A K E S"]]:
    """The same of the members that fly, the last axis."""
    flying: ActorCritic = jax.tree.map(lambda leaf: leaf[league.flying], league.members)
    fly = jax.vmap(ActorCritic.apply, in_axes=(0, -1, -1), out_axes=-1)
    flown: tuple[Carry, Array] = fly(flying, carry, observation)
    return flown


def beaten_by_slot(gates_passed: Int[Array, "N E"]) -> Float[Array, "S"]:
    """How often the active drone passed more gates than an opponent that a member flew; an equal number is half."""
    gates = gates_passed.reshape(len(gates_passed), -1, SHARES)[..., SLOTS:]
    own, others = gates[ACTIVE], gates[ACTIVE + 1 :]
    return jnp.mean(0.5 * (own > others) + 0.5 * (own >= others), axis=(0, 1))


def after_evaluation(state: TrainState, beaten: Float[Array, "S"], key: Array) -> TrainState:
    """Keep the score, and choose anew who flies. Races whose opponents change begin anew."""
    assert state.league is not None
    league = keep_score(state.league, beaten)
    flying = choose_members(league, key)
    restart = state.restart | _races_of(flying != league.flying, state.restart.shape[0])
    return state._replace(league=league._replace(flying=flying), restart=restart)


def keep_score(league: League, beaten: Float[Array, "S"]) -> League:
    """What an evaluation told of those who flew, and Elo's ratings after it."""
    expected = 1 / (1 + 10 ** ((league.rating[league.flying] - league.own_rating) / ELO_SCALE))
    gained = ELO_GAIN * (beaten - expected)
    known = league.beaten.at[league.flying].set(MEMORY * league.beaten[league.flying] + (1 - MEMORY) * beaten)
    rating = league.rating.at[league.flying].add(-gained)
    return league._replace(beaten=known, rating=rating, own_rating=league.own_rating + gained.mean())


def choose_members(league: League, key: Array) -> Int[Array, "S"]:
    """Members drawn in proportion to (1 - beaten)^2, nobody twice unless there are fewer than slots."""
    weight = jnp.where(league.joined >= 0, (1 - league.beaten) ** 2 + LEAST_WEIGHT, 0.0)
    order = jnp.argsort(-(jnp.log(weight) + jax.random.gumbel(key, weight.shape)))[:SLOTS]
    order = jnp.resize(order, (SLOTS,))
    return jnp.where(league.joined[order] >= 0, order, order[0])


def join(state: TrainState, founders: int) -> TrainState:
    """The active policy takes a free place, or that of the member who is beaten most often and is no founder."""
    league = state.league
    assert league is not None
    if founders == len(league.joined):  # nobody ever leaves
        return state
    places = jnp.arange(len(league.joined))
    drop = jnp.where(league.joined < 0, 2.0, league.beaten)
    place = jnp.argmax(jnp.where(places < founders, -1.0, drop))
    members = jax.tree.map(lambda all_, new: all_.at[place].set(new), league.members, state.policy)
    joined = league._replace(
        members=members,
        joined=league.joined.at[place].set(state.updates),
        beaten=league.beaten.at[place].set(UNKNOWN),
        rating=league.rating.at[place].set(league.own_rating),
    )
    restart = state.restart | _races_of(league.flying == place, state.restart.shape[0])
    return state._replace(league=joined, restart=restart)


def standing(league: League) -> dict[str, float]:
    """What is worth a line in a log: how many there are, ratings, and how often the toughest of them is beaten."""
    taken = np.asarray(league.joined) >= 0
    return {
        "members": float(taken.sum()),
        "rating": float(league.own_rating),
        "best_rating": float(np.asarray(league.rating)[taken].max()),
        "toughest_beaten": float(np.asarray(league.beaten)[taken].min()),
    }


def _races_of(slots: Bool[Array, "S"], races: int) -> Bool[Array, "E"]:
    """Races in which the member of one of `slots` flies."""
    shares = jnp.concatenate([jnp.zeros(SLOTS, bool), slots])
    return jnp.tile(shares, races // SHARES)
