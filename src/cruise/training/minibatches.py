"""What a minibatch is: time steps of all races, or whole sequences of some races where a network has a memory."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Shaped

from cruise.config import PPOConfig
from cruise.training.devices import mean_over_devices
from cruise.training.types import Batch

LEAST_DEVIATION = 0.01  # of a group's advantages, as a share of that of all: that of one or two may be rounding
OVER_RACES, OVER_TIME = 1, 0  # axes of [T, E]


def make_minibatches(batch: Batch, config: PPOConfig, axis: str | None) -> tuple[Callable[[Array], Batch], int]:
    """What gives the minibatch of some units, and how many units there are to choose from.

    Without memory a unit is a time step of all races: races are independent, so it is nearly as mixed as a full
    shuffle, and it is gathered by rows of E numbers instead of one by one. With memory it is a race, whose steps stay
    in order; what was remembered before the rollout comes along. Advantages are standardised over the whole minibatch,
    on whatever device of the mesh axis.
    """
    if batch.begins is None:
        by_step = tuple(mean_over_devices(rows, axis) for rows in _moments_of_groups(batch, config, OVER_RACES))

        def time_steps(chosen: Int[Array, "K"]) -> Batch:
            picked: Batch = jax.tree.map(lambda rows: _side_by_side(rows, chosen), batch)
            return _with_standard_advantages(picked, [rows[:, chosen].mean(1) for rows in by_step])

        return time_steps, batch.advantage.shape[0]
    by_race = _moments_of_groups(batch, config, OVER_TIME)

    def sequences(chosen: Int[Array, "K"]) -> Batch:
        picked: Batch = jax.tree.map(lambda leaf: jnp.take(leaf, chosen, axis=-1), batch)
        moments = [mean_over_devices(rows[:, chosen].mean(1), axis) for rows in by_race]
        return _with_standard_advantages(picked, moments)

    return sequences, batch.advantage.shape[1]


def _side_by_side(rows: Shaped[Array, "T *C E"], chosen: Int[Array, "K"]) -> Shaped[Array, "*C KE"]:
    """The chosen time steps, joined along the races: one long batch axis, copied row by row."""
    picked = [jax.lax.dynamic_index_in_dim(rows, chosen[i], keepdims=False) for i in range(chosen.shape[0])]
    return jnp.concatenate(picked, axis=-1)


def _moments(advantage: Float[Array, "T E"], over: int) -> Float[Array, "2 U"]:
    """Mean and mean square of every unit's advantages."""
    return jnp.stack([advantage.mean(over), (advantage**2).mean(over)])


def _moments_among(advantage: Float[Array, "T E"], group: Bool[Array, "T E"], over: int) -> Float[Array, "3 U"]:
    """The same of those in a group, with the others as zeros, and the group's share."""
    shares = group.astype(jnp.float32)
    return jnp.concatenate([_moments(shares * advantage, over), shares.mean(over)[None]])


def _moments_of_groups(batch: Batch, config: PPOConfig, over: int) -> tuple[Array, ...]:
    """Of all advantages that count; where company does, of those without and of those with."""
    counts = None if batch.weight is None else batch.weight > 0
    if config.company_distance == 0:
        return (_moments(batch.advantage, over) if counts is None else _moments_among(batch.advantage, counts, over),)
    groups = ~batch.in_company, batch.in_company
    return tuple(_moments_among(batch.advantage, group if counts is None else group & counts, over) for group in groups)


def _deviation(moments: Float[Array, "2"]) -> Float[Array, ""]:
    mean, square = moments
    return jnp.sqrt(jnp.maximum(square - mean**2, 0.0))


def _of_group(moments: Float[Array, "3"]) -> Float[Array, "2"]:
    """Mean and mean square of a group by themselves."""
    return moments[:2] / jnp.maximum(moments[2], 1e-8)


def _standardised(
    advantage: Float[Array, "*B"], moments: Float[Array, "2"], least: Array | float = 0.0
) -> Float[Array, "*B"]:
    """With mean 0 and deviation 1, or smaller where they deviate by less than `least`."""
    return (advantage - moments[0]) / (jnp.maximum(_deviation(moments), least) + 1e-8)


def _with_standard_advantages(picked: Batch, moments: list[Array]) -> Batch:
    """A minibatch whose advantages are standardised.

    With the moments of two groups, what happens in company is standardised apart from what happens alone: beside an
    opponent one crash outweighs whatever a better line is worth, and standardised by it lines are hardly learned.
    """
    if len(moments) == 1:
        whole = moments[0] if picked.weight is None else _of_group(moments[0])
        return picked._replace(advantage=_standardised(picked.advantage, whole))
    least = LEAST_DEVIATION * _deviation(moments[0][:2] + moments[1][:2])
    alone, company = (_standardised(picked.advantage, _of_group(m), least) for m in moments)
    return picked._replace(advantage=jnp.where(picked.in_company, company, alone))
