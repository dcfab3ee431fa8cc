"""What training carries from one update to the next, and what it reports."""

from typing import NamedTuple

import optax
from jaxtyping import Array, Bool, Float, Int

from cruise.env.types import RaceState
from cruise.pilots.network import ActorCritic, Carries, Carry

ACTIVE = 0  # the drone that learns; it starts in a random lane, so it is no special place


class OpponentPool(NamedTuple):
    """Frozen opponents and which of them flies in which race.

    Two generations are kept, because an opponent is replaced only between episodes: races under way finish against
    the generation they began with.
    """

    newest: ActorCritic
    previous: ActorCritic
    uses_previous: Bool[Array, "E"]
    failed: Int[Array, ""]  # evaluations since the last replacement


class Sparring(NamedTuple):
    """Which opponents are chasers in place of a frozen policy, and how they fly: fixed for a run."""

    speed: Float[Array, "N E"]  # [m/s]; 0: a policy flies
    push: Float[Array, "N E"]  # away from drones nearby, per metre too near [1/s]; 0: it does not see them


class League(NamedTuple):
    """Policies of before, and who of them flies the opponents of which races: see `cruise.training.league`."""

    members: ActorCritic  # one in each of M places, along a leading axis
    joined: Int[Array, "M"]  # number of the update at which each came; -1: the place is empty
    beaten: Float[Array, "M"]  # how often the active policy passed more gates than each lately; an equal number is half
    rating: Float[Array, "M"]  # Elo
    own_rating: Float[Array, ""]  # that of the active policy
    flying: Int[Array, "K"]  # places of those who fly at present


class TrainState(NamedTuple):
    """Everything an update depends on; saved whole in a checkpoint."""

    model: ActorCritic
    optimiser: optax.OptState
    opponents: OpponentPool
    sparring: Sparring
    races: RaceState  # [..., N, E]
    restart: Bool[Array, "E"]  # races that begin anew at the next step
    key: Array
    updates: Int[Array, ""]
    league: League | None = None  # None: there is none
    carries: Carries = Carries((), ())  # what the active policy's networks remember of the races under way [H E]
    opponents_carry: Carry = ()  # what those remember that fly the opponents [H N-1 E]
    average: ActorCritic | None = None  # of the active policy's parameters over the last updates; None: none is kept

    @property
    def policy(self) -> ActorCritic:
        """What a run has to show: it is measured, flies the opponents and is kept."""
        return self.model if self.average is None else self.average


class Transitions(NamedTuple):
    """What the drones that learn lived through in a rollout; E counts them all, drones first, then races."""

    observation: Float[Array, "T O E"]
    action: Float[Array, "T A E"]
    noise_scale: Float[Array, "T E"]  # share of the policy's deviation that it was drawn with
    in_company: Bool[Array, "T E"]  # whether an opponent was near
    log_prob: Float[Array, "T E"]
    value: Float[Array, "T E"]
    reward: Float[Array, "T E"]
    terminated: Bool[Array, "T E"]
    judged: Float[Array, "T C E"] | None = None  # what the value network saw; None: the same as the policy
    begins: Bool[Array, "T E"] | None = None  # a race began in this step; None: no network remembers anything
    counts: Bool[Array, "T E"] | None = None  # it was flown, and something is learned from it; None: all are
    cut: Bool[Array, "T E"] | None = None  # the race ended with it, but not for this drone; None: never


class Batch(NamedTuple):
    """Transitions with what the loss needs of them."""

    observation: Float[Array, "T O E"]
    action: Float[Array, "T A E"]
    noise_scale: Float[Array, "T E"]  # share of the policy's deviation that it was drawn with
    in_company: Bool[Array, "T E"]  # whether an opponent was near
    log_prob: Float[Array, "T E"]
    advantage: Float[Array, "T E"]  # of a minibatch: standardised
    value_target: Float[Array, "T E"]
    judged: Float[Array, "T C E"] | None = None  # what the value network saw; None: the same as the policy
    begins: Bool[Array, "T E"] | None = None  # a race began in this step; None: no network remembers anything
    carries: Carries | None = None  # what the networks remembered before the first step [H E]
    weight: Float[Array, "T E"] | None = None  # 0 where there is nothing to learn, with a mean of 1; None: all 1
