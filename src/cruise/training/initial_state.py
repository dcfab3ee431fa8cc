"""Where a run begins: with random networks, or with policies from elsewhere."""

from collections.abc import Collection

import jax
import numpy as np

from cruise.config import TrainConfig
from cruise.env.observation import alike
from cruise.errors import CruiseError
from cruise.pilots.network import ActorCritic
from cruise.storage.policy_file import read_meta, read_policy
from cruise.training.league import found_league
from cruise.training.trainer import Trainer
from cruise.training.types import TrainState
from cruise.vehicles import find_vehicle, fly_alike


def initial_state(trainer: Trainer) -> TrainState:
    """The trainer's initial state, with policies from elsewhere where its configuration names them.

    Raises:
        CruiseError: there is no such policy, or it is not one for this run.
    """
    state, config = trainer.initial_state(), trainer.config
    model, pool, league = state.model, state.opponents, state.league
    if config.start_from:
        _require_same_critic(config)
        model = _fitting(config.start_from, config, state.model, alike(config.observation))
        pool = pool._replace(newest=model, previous=model)
    if config.against:
        opponent = _fitting(config.against, config, state.model, {config.observation})
        pool = pool._replace(newest=opponent, previous=opponent)
    if league is not None:
        founders = [_fitting(name, config, state.model, {config.observation}) for name in config.opponents.founders]
        league = found_league(model, config.opponents.league, founders)
    average = None if state.average is None else model
    return trainer.place(state._replace(model=model, opponents=pool, league=league, average=average))


def _require_same_critic(config: TrainConfig) -> None:
    """Raises CruiseError where the value network that learns on saw something else before."""
    before = read_meta(config.start_from).critic_observation
    if before != config.critic_observation:
        told = f"give --critic-observation {before or repr(before)}"
        raise CruiseError(f"the value network of policy {config.start_from!r} saw another observation: {told}")


def _fitting(name: str, config: TrainConfig, model: ActorCritic, kinds: Collection[str]) -> ActorCritic:
    """The parameters of a policy. Raises CruiseError where they are not for such a run, or not shaped as `model`.

    `kinds` are the observations that it may have flown by.
    """
    policy = read_policy(name)
    meta = policy.meta
    theirs, ours = find_vehicle(meta.vehicle), find_vehicle(config.vehicle)
    if not fly_alike(theirs, ours) or meta.observation not in kinds:
        raise CruiseError(
            f"policy {name!r} flies a {theirs.name} by the {meta.observation} observation, this run trains for a "
            f"{ours.name} by the {config.observation} one"
        )
    if jax.tree.map(np.shape, policy.params) != jax.tree.map(np.shape, model):
        raise CruiseError(
            f"policy {name!r} has other networks than this run: give --hidden, --network, --memory-size "
            "and --critic-observation as it was trained with"
        )
    return policy.params
