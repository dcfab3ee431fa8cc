"""What a training configuration must satisfy, told in one line each."""

import dataclasses
import math
from collections.abc import Iterator

from cruise.config import PPOConfig, Randomisation, SelfPlayConfig, TrainConfig, Vehicle
from cruise.env.draw_sensing import check_sensing
from cruise.env.observation import find_observation
from cruise.env.payment import find_reward_terms
from cruise.env.randomise import check_randomisation, rival_spreads
from cruise.errors import CruiseError
from cruise.storage.policy_file import MAX_WIDTH
from cruise.training.curriculum import plan_phases
from cruise.vehicles import VEHICLES, check_vehicle, find_vehicle, load_vehicle, reference_to

MAX_DRONES = 16
MAX_SEED = 2**32 - 1
MAY_BE_INFINITE = ("overtake_range", "checkpoint_seconds")


def owning_vehicle(config: TrainConfig) -> TrainConfig:
    """The configuration with all numbers of a vehicle that a file describes, so that the run no longer needs the file.

    Raises:
        CruiseError: there is no such vehicle, or it cannot fly.
    """
    return dataclasses.replace(config, vehicle=reference_to(load_vehicle(config.vehicle)))


def check_config(config: TrainConfig) -> None:
    """Raises CruiseError with the first thing that cannot work."""
    for fault in _faults(config):
        raise CruiseError(fault)


def _faults(config: TrainConfig) -> Iterator[str]:
    known = isinstance(config.vehicle, Vehicle) or config.vehicle in VEHICLES
    if known:
        check_vehicle(find_vehicle(config.vehicle))
    else:
        yield f"unknown vehicle {config.vehicle!r}: there are {', '.join(VEHICLES)}"
    if not 1 <= config.drones <= MAX_DRONES:
        yield f"drones must be between 1 and {MAX_DRONES}, not {config.drones}"
    if not 0 <= config.seed <= MAX_SEED:
        yield f"seed must be between 0 and {MAX_SEED}, not {config.seed}"
    if known:
        check_randomisation(find_vehicle(config.vehicle), config.randomisation)
        check_randomisation(find_vehicle(config.vehicle), Randomisation(**rival_spreads(config.opponents)))
    check_sensing(config.sensing)
    for part in (config, config.reward, config.ppo, config.opponents):
        yield from _not_finite(part)
    yield from _below(1, config, "episode_steps")
    yield from _not_positive(config, "step_scale", "collision_distance", "checkpoint_seconds")
    yield from _ppo_faults(config.ppo)
    yield from _opponent_faults(config.opponents)
    yield from _not_shares(config, "milder_share", "nominal_share", "retry_share", "spread_starts")
    find_observation(config.observation)
    find_reward_terms(config.reward_terms)
    if config.critic_observation:
        find_observation(config.critic_observation)
    if config.learners > 1:
        yield from _shared_faults(config)
    if config.against and config.drones == 1:
        yield "against names who flies the opponents, and one drone has none: raise drones"
    phase = plan_phases(config)[-1]
    if phase.last_update < 1:
        per_update = config.steps_per_update
        yield f"the budget is smaller than one update of {per_update:,} steps: raise step_scale, or lower races"


def _ppo_faults(ppo: PPOConfig) -> Iterator[str]:
    yield from _below(1, ppo, "races", "rollout_steps", "epochs", "minibatches")
    if ppo.network == "gru":
        yield from _recurrent_faults(ppo)
    elif ppo.rollout_steps % ppo.minibatches:
        yield f"rollout_steps ({ppo.rollout_steps}) must be a multiple of minibatches ({ppo.minibatches})"
    if ppo.races < ppo.rollout_steps:
        yield f"races ({ppo.races}) must be at least rollout_steps ({ppo.rollout_steps})"
    yield from _not_positive(ppo, "learning_rate", "clip_ratio", "max_grad_norm")
    yield from _below(
        0,
        ppo,
        *("final_learning_rate", "target_kl", "average_updates"),
        *("value_weight", "entropy_weight", "caution_distance", "company_distance"),
    )
    yield from _not_shares(ppo, "gamma", "gae_lambda", "entropy_hold", "entropy_end", "least_noise")
    if ppo.entropy_end < ppo.entropy_hold:
        yield f"entropy_end ({ppo.entropy_end}) must not be below entropy_hold ({ppo.entropy_hold})"
    if ppo.least_noise == 0:
        yield "least_noise must be above 0, or a drone beside another would never try anything"
    if not ppo.hidden or not 1 <= min(ppo.hidden) <= max(ppo.hidden) <= MAX_WIDTH:
        yield f"hidden must name the width of at least one layer, each from 1 to {MAX_WIDTH}, not {ppo.hidden}"


def _recurrent_faults(ppo: PPOConfig) -> Iterator[str]:
    if ppo.races % ppo.minibatches:
        yield f"races ({ppo.races}) must be a multiple of minibatches ({ppo.minibatches}): they are of whole races"
    if not 1 <= ppo.memory_size <= MAX_WIDTH:
        yield f"memory_size must be from 1 to {MAX_WIDTH}, not {ppo.memory_size}"


def _shared_faults(config: TrainConfig) -> Iterator[str]:
    """Of races in which every drone learns."""
    for name in config.others_fly:
        yield f"learners 'all' leaves {name} no drone to fly: leave out {name}, or let one learn"
    if config.ppo.network == "gru":
        yield "learners 'all' needs a policy without memory: network 'mlp'"


def _opponent_faults(opponents: SelfPlayConfig) -> Iterator[str]:
    yield from _below(1, opponents, "evaluate_every", "evaluation_races", "evaluation_steps")
    yield from _below(0, opponents, "patience", "league")
    if len(opponents.founders) > opponents.league:
        yield f"{len(opponents.founders)} founders need as many places: league is {opponents.league}"
    yield from _not_shares(opponents, "win_threshold", "sparring_share")


def _not_finite(config: object) -> Iterator[str]:
    for field in dataclasses.fields(config):  # type: ignore[arg-type]
        value = getattr(config, field.name)
        if not isinstance(value, float) or math.isfinite(value):
            continue
        if math.isnan(value) or field.name not in MAY_BE_INFINITE:
            yield f"{field.name} must be a finite number, not {value}"


def _below(least: int, config: object, *names: str) -> Iterator[str]:
    for name in names:
        if getattr(config, name) < least:
            yield f"{name} must be {least} or more, not {getattr(config, name)}"


def _not_shares(config: object, *names: str) -> Iterator[str]:
    for name in names:
        if not 0 <= getattr(config, name) <= 1:
            yield f"{name} must be between 0 and 1, not {getattr(config, name)}"


def _not_positive(config: object, *names: str) -> Iterator[str]:
    for name in names:
        if not getattr(config, name) > 0:
            yield f"{name} must be positive, not {getattr(config, name)}"
