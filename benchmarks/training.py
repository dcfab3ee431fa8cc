"""Training: steps per second of `Trainer.update`, and the arithmetic that a step needs at least."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from benchmarks.roofline import Cost, count
from cruise.config import PPOConfig, TrainConfig
from cruise.presets import TRACKS, VEHICLES
from cruise.training.trainer import Trainer
from cruise.training.types import TrainState


class TrainingCase:
    """Updates of a fresh policy on the last stage. Its unit is the environment step of the active drone."""

    def __init__(self, config: TrainConfig) -> None:
        """Build the trainer and compile it, or load what is compiled from the cache."""
        self.trainer = Trainer(config, TRACKS[config.track], VEHICLES[config.vehicle])
        self.work = float(self.trainer.steps_per_update)
        self.state: TrainState = self.trainer.initial_state()
        phase = self.trainer.phases[-1]
        self.rules, self.alone = self.trainer.rules_of(phase), np.asarray(phase.alone)
        self()

    def __call__(self) -> None:
        """One update: a rollout, then all epochs on it."""
        self.state, metrics = self.trainer.update(self.state, self.rules, self.alone)
        jax.block_until_ready((self.state, metrics))

    @property
    def flop(self) -> "TrainFlop":
        """What a step needs at least."""
        return trainer_flop(self.trainer)

    @property
    def cost(self) -> Cost:
        """The same, and the bytes that a step moves. Counted when asked for: a start is timed without it."""
        traced = self.trainer.update.trace(self.state, self.rules, self.alone)
        return Cost(self.flop.total, count(traced.jaxpr).bytes / self.work)


class TrainFlop(NamedTuple):
    """Floating-point operations per environment step of the active drone, in the networks' products alone."""

    acting: float  # policy and value of the active drone, forward, and the value after the last step of a rollout
    opponents: float  # policies of the N - 1 others, forward
    learning: float  # all epochs: policy and value, forward and backward

    @property
    def total(self) -> float:
        """All of it."""
        return self.acting + self.opponents + self.learning


def forward_flop(sizes: Sequence[int]) -> int:
    """Of a perceptron whose layers have these sizes: two, a product and a sum, per weight."""
    return sum(2 * fan_in * fan_out for fan_in, fan_out in itertools.pairwise(sizes))


def backward_flop(sizes: Sequence[int]) -> int:
    """Of its gradient: as much as forward for the weights, and again for the inputs of every layer but the first."""
    return 2 * forward_flop(sizes) - 2 * sizes[0] * sizes[1]


def train_flop(observation_size: int, action_size: int, drones: int, ppo: PPOConfig) -> TrainFlop:
    """What the formulas of PPO ask for, no more: nothing computed twice, no activation, loss or optimiser counted.

    Per epoch that is three times the forward pass, less the gradient with respect to the observation, which nobody
    needs. Adam and the biases are left out, being vectors beside the batch's matrices.
    """
    actor = (observation_size, *ppo.hidden, action_size)
    critic = (observation_size, *ppo.hidden, 1)
    forward = forward_flop(actor) + forward_flop(critic)
    return TrainFlop(
        acting=forward + forward_flop(critic) / ppo.rollout_steps,
        opponents=(drones - 1) * forward_flop(actor),
        learning=ppo.epochs * (forward + backward_flop(actor) + backward_flop(critic)),
    )


def trainer_flop(trainer: Trainer) -> TrainFlop:
    """`train_flop` of a run."""
    env, config = trainer.env, trainer.config
    observation = jax.eval_shape(lambda key: env.observe(env.reset(key, (1,))), jax.random.key(0))
    return train_flop(observation.shape[0], env.dynamics.action_size, config.drones, config.ppo)
