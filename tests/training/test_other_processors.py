"""Learning, its evaluations and the planner are programs for GPUs and TPUs too: they lower for them without one."""

import jax
import jax.numpy as jnp
import pytest

from cruise.env.race_env import make_race_env
from cruise.env.types import stage_rules
from cruise.pilots.named import NAMED
from cruise.presets import CURRICULUM, TRACKS, VEHICLES
from cruise.training.trainer import Trainer
from tests.training.runs import TINY

RULES = jax.tree.map(jnp.asarray, stage_rules(CURRICULUM[-1], 0.4))
ALONE = jnp.array(False)


def learning():
    trainer = Trainer(TINY, TRACKS["ring"], VEHICLES["paper"], jax.devices()[:1])
    return trainer, trainer.state_shape()


def update():
    trainer, state = learning()
    return trainer.update, (state, RULES, ALONE)


def evaluation():
    trainer, state = learning()
    return trainer.evaluate, (state.model, state.opponents.newest, RULES, ALONE, jnp.zeros(2, jnp.uint32), None)


def planner():
    env, pilot, both = make_race_env(TRACKS["ring"], 2, VEHICLES["paper"]), NAMED["se-ibr"], (0, 1)
    state = jax.eval_shape(lambda key: env.reset(key, (4,)), jax.random.key(0))
    memory = jax.eval_shape(lambda state: pilot.init(env, both, state), state)
    return jax.jit(lambda *given: pilot.act(env, both, *given)), (memory, state, jax.random.key(0))


@pytest.mark.parametrize("program", [update, evaluation, planner])
def test_lowers_for_cuda_and_tpu(program):
    function, given = program()
    exported = jax.export.export(function, platforms=("cuda", "tpu"))(*given)
    assert exported.platforms == ("cuda", "tpu")
    assert len(exported.mlir_module_serialized) > 1000
