"""Named vehicles, tracks, curricula and rewards."""

import math
from dataclasses import replace

from cruise.config import (
    PPOConfig,
    Randomisation,
    RewardWeights,
    SelfPlayConfig,
    Stage,
    TrainConfig,
    Vehicle,
)
from cruise.tracks import PAPER_TRACKS, PUBLISHED_TRACKS, TRACKS
from cruise.vehicles import VEHICLES, find_vehicle, reference_to

__all__ = [
    "CURRICULA",
    "CURRICULUM",
    "MAX_RANDOMISE",
    "PAPER_TRACKS",
    "PUBLISHED_TRACKS",
    "RANDOMISATION",
    "REWARDS",
    "TRACKS",
    "VEHICLES",
    "curriculum_of",
    "full_randomisation",
    "training_config",
    "training_randomisation",
    "with_one_learner",
]

# The paper's curriculum table, row by row.
CURRICULUM: tuple[Stage, ...] = (
    Stage("Basics", 1_000_000, 1.0, 2.0, False, 0.0, 0.5, 0.0, False),
    Stage("Intermediate", 3_000_000, 3.0, 3.0, True, 0.25, 0.3, 0.1, False),
    Stage("Advanced", 6_000_000, 5.0, 4.0, True, 0.5, 0.25, 0.2, False),
    Stage("Advanced II", 10_000_000, 7.0, 6.0, True, 0.6, 0.2, 0.2, True),
    Stage("Advanced III", 20_000_000, 10.0, 7.5, True, 0.7, 0.2, 0.2, True),
)

# Theta_k of vehicles flown by thrust and body rates: shares of the budget and of the speed at the limit, the rest after
# the paper's table. They have no use for a stage in which a collision is survived: without termination a drone that
# lies on the ground learns nothing. Their agility is always all their thrust, because it keeps them in the air; that
# progress is paid up to v_min alone is what makes the first stages slow.
_AGILE_STAGES = (
    # name, share, speed, w_coll, gate tolerance, w_over, crash share
    ("Basics", 0.1, 0.3, 0.0, 0.3, 0.0, 0.25),
    ("Intermediate", 0.15, 0.5, 0.25, 0.15, 0.1, 0.4),
    ("Advanced", 0.2, 0.7, 0.5, 0.05, 0.2, 0.6),
    ("Advanced II", 0.25, 0.85, 0.6, 0.0, 0.2, 0.8),
    ("Advanced III", 0.3, 1.0, 0.7, 0.0, 0.2, 1.0),
)


def _agile_curriculum(vehicle: Vehicle, steps: int = 20_000_000) -> tuple[Stage, ...]:
    """Five stages of `steps` in all.

    The speed at the limit grows with the root of the thrust; 17.1 m/s is that of the time-optimal lap of the ring at a
    thrust-to-weight ratio of 3.3.
    """
    limit = 17.1 * math.sqrt(vehicle.agility / (3.3 * vehicle.gravity))
    return tuple(
        Stage(
            name,
            round(share * steps),
            v_min=speed * limit,
            agility=vehicle.agility,
            collision_penalty=w_coll > 0,
            w_coll=w_coll,
            gate_tolerance=tolerance,
            w_over=w_over,
            terminal_collisions=True,
            crash_share=crash,
        )
        for name, share, speed, w_coll, tolerance, w_over, crash in _AGILE_STAGES
    )


def curriculum_of(vehicle: Vehicle) -> tuple[Stage, ...]:
    """Theta_k of a vehicle: the paper's table, or with rotors its own."""
    return {"cascade": lambda: CURRICULUM, "rotors": lambda: _agile_curriculum(vehicle)}[vehicle.flown_by]()


CURRICULA: dict[str, tuple[Stage, ...]] = {name: curriculum_of(vehicle) for name, vehicle in VEHICLES.items()}

REWARDS: dict[str, RewardWeights] = {
    "default": RewardWeights(),
    # As printed, with the constants of the paper's repository.
    "paper": RewardWeights(
        w_prox=0.52,
        w_prog=1.51,
        progress_to="centre",
        w_align=0.17,
        w_speed=0.2,
        speed_zero_at="v_min",
        overtake_sign="paper",
        overtake_range=math.inf,
        gate_bonus=1.0,
        w_edge=0.0,
        w_near=0.0,
        terminal=-1.0,
    ),
    # Progress, in metres, is nearly all of it: at 50 Hz and 17 m/s a step is worth 0.34.
    "agile": RewardWeights(
        w_prog=1.0,
        progress_scale=1.0,
        pay_up_to_v_min=True,
        w_align=0.0,
        w_speed=0.0,
        gate_bonus=1.0,
        w_edge=15.0,
        edge_margin=0.25,
        w_beside=15.0,
        w_near=0.3,
        near_distance=1.5,
        terminal=-20.0,
    ),
}


# What a real drone may differ by: a vehicle weighed and measured with care, a battery somewhere between full and empty,
# the state estimate of a good visual-inertial odometry, gates set up by hand, a light breeze out of doors.
_SENSED = Randomisation(
    gate_shift=0.1,
    gate_turn=0.05,
    position_error=0.05,
    velocity_error=0.1,
    attitude_error=0.015,
    rate_error=0.05,
)
_REAL = replace(
    _SENSED,
    mass_spread=0.1,
    inertia_spread=0.2,
    thrust_spread=0.1,
    drag_spread=0.4,
    lag_spread=0.3,
    clip_share=1.0,
    extra_delay=0.02,
    wind_speed=3.0,
    gust_speed=1.0,
)
_INDOORS = replace(_REAL, wind_speed=1.0, gust_speed=0.3)
MAX_RANDOMISE = 2.0  # times as strong as full


def full_randomisation(vehicle: Vehicle) -> Randomisation:
    """What counts as all that a vehicle may differ by, as far as it can differ at all (`Vehicle.randomisable`)."""
    full = _INDOORS if vehicle.indoors else _REAL
    return Randomisation(**{name: getattr(full, name) for name in vehicle.randomisable})


RANDOMISATION: dict[str, Randomisation] = {name: full_randomisation(vehicle) for name, vehicle in VEHICLES.items()}

# One opponent, or none, leaves room for bolder learning than two or three: smaller updates, faster, with more noise for
# longer. Among four drones the same is too much: half of them crash.
_BOLD = PPOConfig(
    races=256,
    learning_rate=1.4e-3,
    gae_lambda=0.95,
    initial_log_std=0.0,
    entropy_weight=0.02,
    entropy_hold=0.5,
    entropy_end=0.8,
)


def training_randomisation(vehicle: str | Vehicle, share: float) -> Randomisation:
    """So much of a vehicle's full randomisation; but a demand is cut in one way or the other: both must be known."""
    full = full_randomisation(find_vehicle(vehicle))
    return replace(full.scaled(share), clip_share=full.clip_share) if share else Randomisation()


def training_config(vehicle: str | Vehicle = "paper", drones: int = TrainConfig.drones) -> TrainConfig:
    """What so many drones of a vehicle are trained with where nobody says otherwise.

    The recipe is that of what the vehicle is flown by, `Vehicle.flown_by`.
    """
    found = find_vehicle(vehicle)
    recipe = {"cascade": _cascade_recipe, "rotors": _agile_recipe}[found.flown_by]
    return replace(recipe(found, drones), vehicle=reference_to(found))


def with_one_learner(config: TrainConfig) -> TrainConfig:
    """The same recipe where one drone of every race learns, as many in all."""
    if config.learners == 1:
        return config
    alone = training_config(config.vehicle, 1)
    opponents = replace(config.opponents, learners="one", evaluate_every=alone.opponents.evaluate_every)
    return replace(config, ppo=replace(config.ppo, races=alone.ppo.races), opponents=opponents)


def _cascade_recipe(vehicle: Vehicle, drones: int) -> TrainConfig:
    del vehicle
    crowded = drones > 3
    return TrainConfig(
        drones=drones,
        # In a crowd who crashes does so soon after the start: in 30 s drones start twice as often as in 60 s.
        episode_steps=300 if crowded else 600,
        ppo=_BOLD if drones <= 2 else PPOConfig(),
        # As many partners as opponents in a race: of three one in ten is enough, one in five disturbs the rest.
        opponents=SelfPlayConfig(sparring_share=0.1 if crowded else 0.2),
    )


def _agile_recipe(vehicle: Vehicle, drones: int) -> TrainConfig:
    """What docs/learning.md measures."""
    common = TrainConfig(
        drones=drones,
        observation="racing",
        critic_observation="racing-far",
        reward=REWARDS["agile"],
        # With the value of a restart, a drone that starts low learns to dive and start anew.
        ppo=PPOConfig(
            gamma=0.995,
            gae_lambda=0.98,
            value_loss="relative",
            after_crash="nothing",
            entropy_weight=0.0,
            hidden=(128, 128),
            initial_log_std=-0.3,
            caution_distance=1.5,
        ),
        opponents=SelfPlayConfig(vary_field=True, sparring_share=0.2, evaluation_steps=1000),  # 20 s
        episode_steps=600,  # 12 s: a drone alone sees the whole of a track that it starts at one place of
        retry_share=0.5,
        randomisation=training_randomisation(vehicle, 0.5),
    )
    return common if drones == 1 else _together(common)


def _together(alone: TrainConfig) -> TrainConfig:
    """Fields: all drones learn, about as many in all as there are races of a drone alone."""
    least = alone.ppo.rollout_steps
    races = max(1, alone.ppo.races // alone.drones // least) * least  # so many that any few cores share them equally
    return replace(
        alone,
        observation="racing-near",  # who is far away must not disturb
        ppo=replace(alone.ppo, races=races, epochs=2, final_learning_rate=2e-5, average_updates=80),
        opponents=replace(alone.opponents, learners="all", evaluate_every=2_000_000),
        episode_steps=300,  # 6 s, because fields soon draw out
        spread_starts=0.5,
        retry_share=0.25,
        nominal_share=0.25,  # drones that differ soon part; those that do not are in company to the end
    )
