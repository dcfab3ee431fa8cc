"""Fields too large for loops over opponents to be written out give the numbers that those would."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.env import view
from cruise.env.reward import overtakes
from cruise.env.step_view import StepView
from cruise.env.types import RaceState
from cruise.env.view import View
from cruise.pilots.scripted import push_apart
from cruise.racing import field
from cruise.racing.gates import Crossing
from tests.env.races import race_env, rules_of, state_of
from tests.helpers import leaves

DRONES = field.UNROLLED + 2
NO, ZERO = jnp.zeros(DRONES, bool), jnp.zeros(DRONES)
CALM = Crossing(NO, NO, NO, ZERO, ZERO, ZERO)


def test_scanned_and_gathered_opponents_are_those_written_out(monkeypatch: pytest.MonkeyPatch) -> None:
    env = race_env(DRONES)
    rng = np.random.default_rng(0)
    middle = np.array([[0.0], [0.0], [3.0]])
    position, velocity = (middle + rng.uniform(-1.5, 1.5, (3, DRONES)) for _ in range(2))
    position[:, 1] = position[:, 2]  # as far from everybody: ties
    state = state_of(env, position, velocity)
    state = state._replace(out=jnp.arange(DRONES) % 4 == 3)

    def seen(now: RaceState) -> tuple:
        look = View(env.course, env.dynamics, now)
        body = now.drones.body
        after = now.drones._replace(body=body._replace(position_w=body.position_w + 0.3 * body.velocity_w))
        step = StepView(look, after, jnp.zeros((3, DRONES)), [CALM], jnp.zeros(DRONES), now.out, rules_of())
        counted = overtakes(step, 2.0, "mended")
        return look.all_nearest, look.nearest(3), counted, push_apart(look.position_w, now.airborne, 1.5, 2.0)

    assert View(env.course, env.dynamics, state).is_large
    many = leaves(jax.jit(seen)(state))
    for module in (field, view):
        monkeypatch.setattr(module, "UNROLLED", DRONES)
    written_out = leaves(jax.jit(functools.partial(seen))(state))  # traced anew
    assert any(np.any(one > 0) for one in written_out[-2:-1])
    for one, other in zip(many, written_out, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6)
