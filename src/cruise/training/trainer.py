"""The trainer: a generator of progress. It prints nothing and writes nothing."""

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec
from jaxtyping import Array, UInt32

from cruise.config import Track, TrainConfig, Vehicle
from cruise.env.payment import find_reward_terms, make_reward
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.randomise import made_for, perturbation, rival_spreads
from cruise.env.types import RaceState, Rules, stage_rules
from cruise.errors import CruiseError
from cruise.pilots.network import ActorCritic, NetworkShape
from cruise.training.curriculum import Phase, plan_phases
from cruise.training.devices import (
    AXIS,
    choose_devices,
    make_mesh,
    mean_over_devices,
    over_races,
    shardings,
    state_specs,
)
from cruise.training.experience import Draws, draw, hide_opponents, make_collect, spread_of
from cruise.training.league import SHARES, after_evaluation, found_league, join
from cruise.training.ppo import flatten, make_learn, make_optimiser
from cruise.training.random_keys import evaluation_keys, run_keys
from cruise.training.self_play import Score, has_mastered, make_evaluate, may_replace, play_on, replace_opponents
from cruise.training.sparring import draw_sparring
from cruise.training.types import League, OpponentPool, TrainState


class Progress(NamedTuple):
    """Where a run stands after an update."""

    state: TrainState
    phase: Phase
    steps: int  # environment steps of all who learn so far
    metrics: dict[str, Array]  # of the rollout and of the loss, scalars
    score: Score | None  # when this update was followed by an evaluation
    opponents_replaced: bool
    phase_ended: bool


class TrainingDiverged(CruiseError):
    """A loss or a parameter is no longer a finite number."""


class Trainer:
    """Compiled functions of one run. Stateless between calls: `TrainState` is all there is."""

    def __init__(
        self, config: TrainConfig, track: Track, vehicle: Vehicle, devices: Sequence[jax.Device] | None = None
    ) -> None:
        """Build the environment and compile lazily.

        `devices` share the races equally; by default `choose_devices` does. With the same number of them the same
        seed gives the same run bit for bit, with another number the same but for the rounding of sums.
        """
        self.config = config
        self.phases = plan_phases(config)
        self.total_updates = self.phases[-1].last_update
        self.steps_per_update = config.steps_per_update
        self.total_steps = self.total_updates * self.steps_per_update
        vehicle = made_for(vehicle, config.randomisation)
        shares = config.milder_share, config.nominal_share
        rivals = rival_spreads(config.opponents)
        perturb = perturbation(track, vehicle, config.randomisation, *shares, sensing=config.sensing, rivals=rivals)
        reward = make_reward(config.reward, find_reward_terms(config.reward_terms))
        self.env: RaceEnv = make_race_env(track, config.drones, vehicle, config.observation, reward, perturb)
        self.optimiser = make_optimiser(config.ppo, self.total_updates)
        self.mesh = make_mesh(devices or choose_devices(config.ppo.races, learners=config.learners))
        if config.opponents.league and config.ppo.races // self.mesh.size % SHARES:
            raise CruiseError(f"with a league every device flies a multiple of {SHARES} races: change races or devices")
        if config.ppo.network == "gru" and config.ppo.races // self.mesh.size % config.ppo.minibatches:
            raise CruiseError(
                "with memory every device needs a multiple of minibatches of races: change --races or --minibatches"
            )
        everywhere = NamedSharding(self.mesh, PartitionSpec())
        self.places = placed = shardings(self.mesh, state_specs(self.state_shape()))
        self.update = jax.jit(
            self._make_update(), in_shardings=(placed, everywhere, everywhere), out_shardings=(placed, everywhere)
        )
        self.evaluate = jax.jit(self._make_evaluate(), in_shardings=everywhere)
        self.start = jax.jit(self._start, out_shardings=placed)

    def _make_update(self) -> Callable[[TrainState, Rules, Array], tuple[TrainState, dict[str, Array]]]:
        """Every device flies and learns from its own races; random numbers are those of all races together."""
        ppo, env = self.config.ppo, self.env
        collect = make_collect(env, self.config)
        learn = make_learn(ppo, self.optimiser, self.total_updates, AXIS)

        def fly_and_learn(state: TrainState, draws: Draws, rules: Rules, alone: Array, key: Array) -> tuple:
            state, experience = collect(state, draws, rules, alone)
            state, metrics = learn(state, experience, key)
            return state, mean_over_devices(experience.metrics | metrics, AXIS)

        draw_all = functools.partial(draw, env, config=self.config)
        draw_specs = over_races(jax.eval_shape(draw_all, jax.random.key(0)))
        specs, everywhere = state_specs(self.state_shape()), PartitionSpec()
        on_devices = jax.shard_map(
            fly_and_learn,
            mesh=self.mesh,
            in_specs=(specs, draw_specs, everywhere, everywhere, everywhere),
            out_specs=(specs, everywhere),
            check_vma=False,
        )

        def update(state: TrainState, rules: Rules, alone: Array) -> tuple[TrainState, dict[str, Array]]:
            key, draw_key, shuffle_key = jax.random.split(state.key, 3)
            draws = jax.lax.with_sharding_constraint(draw_all(draw_key), shardings(self.mesh, draw_specs))
            state, metrics = on_devices(state._replace(key=key), draws, rules, alone, shuffle_key)
            metrics["policy/norm"] = jnp.linalg.norm(flatten(state.model))
            return state, metrics

        return update

    def _make_evaluate(self) -> Callable[..., Score]:
        evaluate = make_evaluate(self.env, self.config.opponents)

        def evaluate_update(
            model: ActorCritic,
            opponents: ActorCritic,
            rules: Rules,
            alone: Array,
            origin: UInt32[Array, "2"],
            league: League | None,
        ) -> Score:
            """`origin`: the seed and the number of the update that is evaluated."""
            return evaluate(model, opponents, rules, alone, evaluation_keys(origin)[0], league)

        return evaluate_update

    def _start(self, key: Array) -> TrainState:
        """A fresh state: opponents equal to the active policy, episodes of random ages, which never end together."""
        model_key, race_key, age_key, key, sparring_key = run_keys(key)
        ppo, env = self.config.ppo, self.env
        races = env.reset(race_key, (ppo.races,), spread=spread_of(env, self.config))
        model = ActorCritic(self._network_shape(races), ppo.initial_log_std, model_key)
        races = hide_opponents(races, jnp.asarray(self.phases[0].alone))
        races = races._replace(step=jax.random.randint(age_key, (ppo.races,), 0, self.config.episode_steps))
        nobody = jnp.zeros(ppo.races, bool)
        pool = OpponentPool(model, model, nobody, jnp.zeros((), jnp.int32))
        share = self.config.opponents.sparring_share
        return TrainState(
            model=model,
            optimiser=self.optimiser.init(flatten(model)),
            opponents=pool,
            sparring=draw_sparring(sparring_key, env, ppo.races, share),
            races=races,
            restart=nobody,
            key=key,
            updates=jnp.zeros((), jnp.int32),
            league=found_league(model, self.config.opponents.league) if self.config.opponents.league else None,
            carries=model.init_carries((ppo.races,)),
            opponents_carry=model.init_carry((env.num_drones - 1, ppo.races)),
            average=model if ppo.average_updates else None,
        )

    def _network_shape(self, races: RaceState) -> NetworkShape:
        ppo, critic = self.config.ppo, self.config.critic_observation
        return NetworkShape(
            observation_size=self.env.observe(races).shape[0],
            action_size=self.env.dynamics.action_size,
            hidden=ppo.hidden,
            kind=ppo.network,
            memory_size=ppo.memory_size,
            critic_observation_size=self.env.observe_as[critic](races).shape[0] if critic else 0,
        )

    def initial_state(self) -> TrainState:
        """The state before the first update, a function of the seed."""
        return self.start(jax.random.key(self.config.seed))

    def place(self, state: TrainState) -> TrainState:
        """A state, read from a file or trained elsewhere, on the devices of this trainer."""
        placed: TrainState = jax.device_put(state, self.places)
        return placed

    def state_shape(self) -> TrainState:
        """Shapes and types of a state, for reading a checkpoint."""
        return jax.eval_shape(self._start, jax.random.key(0))

    def phase_of(self, update: int) -> Phase:
        """The phase in which update number `update` (from 0) is trained."""
        return next(phase for phase in self.phases if update < phase.last_update)

    def rules_of(self, phase: Phase) -> Rules:
        """The traced rules of a phase, in memory of the host, whence they reach every device."""
        return jax.tree.map(_on_host, stage_rules(phase.stage, self.config.collision_distance))

    def run(self, state: TrainState) -> Iterator[Progress]:
        """Train from `state` to the end, yielding after every update.

        Raises:
            TrainingDiverged: when anything measured, the norm of the parameters included, is not finite any more.
                Whatever was yielded before is sound.
        """
        state = self.place(state)
        done = int(state.updates)
        while done < self.total_updates:
            phase = self.phase_of(done)
            rules, alone = self.rules_of(phase), np.asarray(phase.alone)
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
        self, state: TrainState, phase: Phase, rules: Rules, alone: np.ndarray | Array
    ) -> tuple[Score, TrainState, bool]:
        origin = np.array([self.config.seed, int(state.updates)], np.uint32)
        score = self.evaluate(state.policy, state.opponents.newest, rules, alone, origin, state.league)
        if state.league is not None:
            state = after_evaluation(state, score.beaten, evaluation_keys(origin)[1])
        score = Score(*(float(x) for x in score[:4]))  # type: ignore[arg-type]
        if not phase.self_play or self.config.against:
            return score, state, False
        if has_mastered(state, score, self.config.opponents) and may_replace(state):
            if state.league is not None:
                state = join(state, len(self.config.opponents.founders))
            return score, replace_opponents(state), True
        return score, play_on(state), False


def _on_host(number: float | int | bool) -> np.ndarray:
    return np.asarray(number, jnp.result_type(type(number)))


def _check_finite(metrics: dict[str, Array], steps: int) -> None:
    bad = [name for name, value in jax.device_get(metrics).items() if not np.isfinite(value)]
    if bad:
        raise TrainingDiverged(
            f"training diverged: {bad[0]} is not finite after {steps:,} steps; try a lower learning rate"
        )
