"""The trainer: a generator of progress. It prints nothing and writes nothing."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cruise.config import Track, TrainConfig, Vehicle
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.types import Rules, stage_rules
from cruise.errors import CruiseError
from cruise.pilots.network import ActorCritic
from cruise.training.curriculum import Phase, plan_phases
from cruise.training.experience import hide_opponents, make_collect
from cruise.training.ppo import make_learn, make_optimiser
from cruise.training.self_play import Score, has_mastered, make_evaluate, may_replace, play_on, replace_opponents
from cruise.training.types import OpponentPool, TrainState


class Progress(NamedTuple):
    """Where a run stands after an update."""

    state: TrainState
    phase: Phase
    steps: int  # environment steps of the active drone so far
    metrics: dict[str, Array]  # of the rollout and of the loss, scalars
    score: Score | None  # when this update was followed by an evaluation
    opponents_replaced: bool
    phase_ended: bool


class TrainingDiverged(CruiseError):
    """A loss or a parameter is no longer a finite number."""


class Trainer:
    """Compiled functions of one run. Stateless between calls: `TrainState` is all there is."""

    def __init__(self, config: TrainConfig, track: Track, vehicle: Vehicle) -> None:
        """Build the environment and compile lazily."""
        self.config = config
        self.phases = plan_phases(config)
        self.total_updates = self.phases[-1].last_update
        self.steps_per_update = config.ppo.races * config.ppo.rollout_steps
        self.total_steps = self.total_updates * self.steps_per_update
        self.env: RaceEnv = make_race_env(track, config.drones, vehicle, config.observation, config.reward)
        self.optimiser = make_optimiser(config.ppo, self.total_updates)
        self.update = jax.jit(self._make_update())
        self.evaluate = jax.jit(make_evaluate(self.env, config.opponents))
        self.start = jax.jit(self._start)

    def _make_update(self) -> Callable[[TrainState, Rules, Array], tuple[TrainState, dict[str, Array]]]:
        ppo = self.config.ppo
        collect = make_collect(self.env, ppo.races, ppo.rollout_steps, self.config.episode_steps)
        learn = make_learn(ppo, self.optimiser, self.total_updates)

        def update(state: TrainState, rules: Rules, alone: Array) -> tuple[TrainState, dict[str, Array]]:
            state, experience = collect(state, rules, alone)
            state, metrics = learn(state, experience)
            metrics["policy/norm"] = jnp.sqrt(sum(jnp.vdot(x, x) for x in jax.tree.leaves(state.model)))
            return state, experience.metrics | metrics

        return update

    def _start(self, key: Array) -> TrainState:
        """A fresh state: opponents equal to the active policy, episodes of random ages, which never end together."""
        model_key, race_key, age_key, key = jax.random.split(key, 4)
        ppo, env = self.config.ppo, self.env
        races = env.reset(race_key, (ppo.races,))
        size = env.observe(races).shape[0]
        model = ActorCritic(size, env.dynamics.action_size, ppo.hidden, ppo.initial_log_std, model_key)
        races = hide_opponents(races, jnp.asarray(self.phases[0].alone))
        races = races._replace(step=jax.random.randint(age_key, (ppo.races,), 0, self.config.episode_steps))
        nobody = jnp.zeros(ppo.races, bool)
        pool = OpponentPool(model, model, nobody, jnp.zeros((), jnp.int32))
        return TrainState(model, self.optimiser.init(model), pool, races, nobody, key, jnp.zeros((), jnp.int32))

    def initial_state(self) -> TrainState:
        """The state before the first update, a function of the seed."""
        return self.start(jax.random.key(self.config.seed))

    def state_shape(self) -> TrainState:
        """Shapes and types of a state, for reading a checkpoint."""
        return jax.eval_shape(self._start, jax.random.key(0))

    def phase_of(self, update: int) -> Phase:
        """The phase in which update number `update` (from 0) is trained."""
        return next(phase for phase in self.phases if update < phase.last_update)

    def rules_of(self, phase: Phase) -> Rules:
        """The traced rules of a phase."""
        return jax.tree.map(jnp.asarray, stage_rules(phase.stage, self.config.collision_distance))

    def run(self, state: TrainState) -> Iterator[Progress]:
        """Train from `state` to the end, yielding after every update.

        Raises:
            TrainingDiverged: when anything measured, the norm of the parameters included, is not finite any more.
                Whatever was yielded before is sound.
        """
        done = int(state.updates)
        while done < self.total_updates:
            phase = self.phase_of(done)
            rules, alone = self.rules_of(phase), jnp.asarray(phase.alone)
            state, metrics = self.update(state, rules, alone)
            done += 1
            steps = done * self.steps_per_update
            _check_finite(metrics, steps)
            phase_ended = done == phase.last_update
            score, replaced = None, False
            if phase_ended or self._evaluation_due(done):
                score, state, replaced = self._evaluate_and_replace(state, phase, rules, alone)
            yield Progress(state, phase, steps, metrics, score, replaced, phase_ended)

    def _evaluation_due(self, done: int) -> bool:
        every = self.config.opponents.evaluate_every
        return (done * self.steps_per_update) // every > ((done - 1) * self.steps_per_update) // every

    def _evaluate_and_replace(
        self, state: TrainState, phase: Phase, rules: Rules, alone: Array
    ) -> tuple[Score, TrainState, bool]:
        key = jax.random.fold_in(jax.random.key(self.config.seed + 1), state.updates)
        score = self.evaluate(state.model, state.opponents.newest, rules, alone, key)
        score = Score(*(float(x) for x in score))
        if not phase.self_play:
            return score, state, False
        if has_mastered(state, score, self.config.opponents) and may_replace(state):
            return score, replace_opponents(state), True
        return score, play_on(state), False


def _check_finite(metrics: dict[str, Array], steps: int) -> None:
    bad = [name for name, value in jax.device_get(metrics).items() if not np.isfinite(value)]
    if bad:
        raise TrainingDiverged(
            f"training diverged: {bad[0]} is not finite after {steps:,} steps; try a lower learning rate"
        )
