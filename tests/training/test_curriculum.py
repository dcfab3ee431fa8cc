"""The plan of a run against the paper's table, and a whole run through all of its stages."""

from dataclasses import replace
from itertools import pairwise

import jax
import numpy as np
import pytest

from cruise.config import PPOConfig, TrainConfig
from cruise.env.types import stage_rules
from cruise.presets import CURRICULUM, TRACKS, VEHICLES, training_config
from cruise.storage.checkpoint import load_checkpoint, save_checkpoint
from cruise.training.curriculum import plan_phases
from cruise.training.self_play import play_on, replace_opponents
from cruise.training.trainer import Trainer
from tests.training.runs import PER_UPDATE, TINY, UPDATES, bits, tiny_trainer, whole_run

MILLION = 1_000_000
# The paper's table: steps, v_min, alpha, c_enable, w_coll, g_tol, w_over, terminal collisions.
TABLE = (
    (1 * MILLION, 1.0, 2.0, False, 0.0, 0.5, 0.0, False),
    (3 * MILLION, 3.0, 3.0, True, 0.25, 0.3, 0.1, False),
    (6 * MILLION, 5.0, 4.0, True, 0.5, 0.25, 0.2, False),
    (10 * MILLION, 7.0, 6.0, True, 0.6, 0.2, 0.2, True),
    (20 * MILLION, 10.0, 7.5, True, 0.7, 0.2, 0.2, True),
)
SIZES = {
    "default": TrainConfig(),
    "tiny": TINY,
    "odd": TrainConfig(ppo=PPOConfig(races=1000, rollout_steps=48, minibatches=16)),
    "short": TrainConfig(step_scale=0.05),
}


def with_mode(config: TrainConfig, mode: str) -> TrainConfig:
    return replace(config, opponents=replace(config.opponents, self_play=mode))


@pytest.mark.parametrize("size", SIZES)
def test_the_plan_is_the_papers_table(size):
    config = SIZES[size]
    per_update = config.ppo.races * config.ppo.rollout_steps
    phases = plan_phases(config)
    assert [phase.number for phase in phases] == [1, 2, 3, 4, 5]
    end, budget = 0, 0.0
    for phase, (steps, *theta) in zip(phases, TABLE, strict=True):
        assert phase.first_update == end
        end, budget = phase.last_update, budget + steps * config.step_scale
        assert 0 <= budget - end * per_update < per_update
        stage = phase.stage
        found = [stage.v_min, stage.agility, stage.collision_penalty, stage.w_coll]
        found += [stage.gate_tolerance, stage.w_over, stage.terminal_collisions]
        assert found == theta
    assert end * per_update <= 40 * MILLION * config.step_scale


def test_stages_of_agile_vehicles_are_faster_narrower_and_dearer_one_by_one():
    config = training_config("racer")
    phases = plan_phases(config)
    assert not any(phase.alone for phase in phases)
    assert sum(phase.stage.steps for phase in phases) == 20 * MILLION
    for before, after in pairwise(phase.stage for phase in phases):
        assert before.v_min < after.v_min
        assert before.gate_tolerance >= after.gate_tolerance
        assert before.crash_share < after.crash_share
    last = phases[-1].stage
    assert (last.gate_tolerance, last.crash_share, last.agility) == (0.0, 1.0, VEHICLES["racer"].agility)
    assert config.opponents.vary_field
    assert (config.observation, config.learners) == ("racing-near", config.drones)


@pytest.mark.parametrize("mode", ["within", "after", "off"])
@pytest.mark.parametrize("size", SIZES)
def test_vanilla_flies_the_last_stage_for_as_long(size, mode):
    config = with_mode(SIZES[size], mode)
    vanilla = plan_phases(replace(config, vanilla=True))
    assert {phase.number for phase in vanilla} == {5}
    assert vanilla[0].first_update == 0
    assert vanilla[-1].last_update == plan_phases(config)[-1].last_update
    assert all(stage_rules(p.stage, 0.5) == stage_rules(CURRICULUM[4], 0.5) for p in vanilla)


@pytest.mark.parametrize(
    ("mode", "alone", "self_play"),
    [
        ("within", [False] * 5, [True] * 5),
        ("off", [True] * 5, [False] * 5),
        ("after", [True] * 5 + [False], [False] * 5 + [True]),
    ],
)
def test_modes_of_self_play(mode, alone, self_play):
    phases = plan_phases(with_mode(TrainConfig(), mode))
    assert [phase.alone for phase in phases] == alone
    assert [phase.self_play for phase in phases] == self_play
    assert [phase.last_update for phase in phases[:-1]] == [phase.first_update for phase in phases[1:]]
    assert phases[-1].last_update == plan_phases(TrainConfig())[-1].last_update
    single = plan_phases(with_mode(TrainConfig(drones=1), mode))
    assert all(phase.alone and not phase.self_play for phase in single)


def test_self_play_after_takes_half_of_the_last_stage():
    config = with_mode(TrainConfig(), "after")
    *_, before, shared = plan_phases(config)
    updates = 10 * MILLION / (config.ppo.races * config.ppo.rollout_steps)
    assert before.number == shared.number == 5
    assert before.last_update - before.first_update == pytest.approx(updates, abs=1)
    assert shared.last_update - shared.first_update == pytest.approx(updates, abs=1)
    assert replace(shared.stage, name="", steps=0) == replace(before.stage, name="", steps=0)


def test_rules_carry_the_stages_numbers():
    for stage, (_, v_min, alpha, enabled, w_coll, g_tol, w_over, terminal) in zip(CURRICULUM, TABLE, strict=True):
        rules = stage_rules(stage, 0.4)
        assert (rules.v_min, rules.agility, rules.gate_tolerance, rules.w_over) == (v_min, alpha, g_tol, w_over)
        assert (rules.w_coll, rules.terminal_collisions) == (w_coll if enabled else 0.0, terminal)
        assert (rules.collision_distance, rules.gates_to_finish) == (0.4, 0)
    disabled = replace(CURRICULUM[4], collision_penalty=False)
    assert stage_rules(disabled, 0.4).w_coll == 0.0
    trainer = tiny_trainer()
    for phase in trainer.phases:
        expected = stage_rules(phase.stage, TINY.collision_distance)
        assert [float(x) for x in trainer.rules_of(phase)] == pytest.approx([float(x) for x in expected])


def test_a_run_goes_through_every_update_and_stage():
    run, trainer = whole_run(), tiny_trainer()
    assert trainer.total_updates == UPDATES == len(run)
    assert [int(p.state.updates) for p in run] == list(range(1, UPDATES + 1))
    assert [p.steps for p in run] == [PER_UPDATE * k for k in range(1, UPDATES + 1)]
    assert [trainer.phase_of(k) for k in range(UPDATES)] == [p.phase for p in run]
    assert [p.phase.number for p in run if p.phase_ended] == [1, 2, 3, 4, 5]
    assert [int(p.state.updates) for p in run if p.phase_ended] == [phase.last_update for phase in trainer.phases]
    evaluated = [p.steps for p in run if p.score is not None]
    due = {s for s in range(PER_UPDATE, 47_200, PER_UPDATE) if s % TINY.opponents.evaluate_every == 0}
    assert set(evaluated) == due | {p.steps for p in run if p.phase_ended}


def test_weights_are_carried_over_between_stages():
    """The first update of a stage starts from everything the last one left: model, optimiser, races, opponents."""
    run, trainer = whole_run(), tiny_trainer()
    ends = [k for k, progress in enumerate(run) if progress.phase_ended][:-1]
    assert len(ends) == 4
    for k in ends:
        before, after = run[k], run[k + 1]
        assert after.phase.number == before.phase.number + 1
        state, _ = trainer.update(before.state, trainer.rules_of(after.phase), np.asarray(after.phase.alone))
        assert bits(state.model) == bits(after.state.model)
        assert bits(state.optimiser) == bits(after.state.optimiser)
        assert bits(state.model) != bits(before.state.model)


def test_nothing_is_ever_compiled_twice(tmp_path):
    """Not for a new stage, nor for flying alone, new opponents, or a state that was read from a checkpoint."""
    run, trainer = whole_run(), tiny_trainer()
    state = run[-1].state
    save_checkpoint(tmp_path, state, {})
    read, _ = load_checkpoint(tmp_path, trainer.state_shape())
    for phase in trainer.phases:
        for start in (trainer.initial_state(), state, trainer.place(read), replace_opponents(state), play_on(state)):
            rules, origin = trainer.rules_of(phase), np.array([0, 1], np.uint32)
            after, _ = trainer.update(start, rules, np.asarray(True))
            trainer.evaluate(after.model, after.opponents.newest, rules, np.asarray(False), origin, None)
    assert trainer.update._cache_size() == 1
    assert trainer.evaluate._cache_size() == 1
    assert trainer.start._cache_size() == 1


def test_building_a_trainer_compiles_nothing():
    trainer = Trainer(TINY, TRACKS["ring"], VEHICLES["paper"])
    assert trainer.update._cache_size() == trainer.start._cache_size() == 0
    shapes = jax.tree.map(lambda x: (x.shape, x.dtype), trainer.state_shape())
    assert shapes == jax.tree.map(lambda x: (x.shape, x.dtype), whole_run()[-1].state)


def test_everything_measured_is_a_finite_number():
    for progress in whole_run():
        assert all(np.shape(value) == () and np.isfinite(value) for value in progress.metrics.values())
