"""Any observation is exported as it is declared, and any number of others is cut down to the nearest."""

import jax.numpy as jnp
import numpy as np
import onnxruntime
import pytest

from cruise.export.contract import export_env, make_contract
from cruise.export.onnx_policy import onnx_model
from cruise.export.parts import make_parts, nearest_others
from cruise.export.pilot_program import make_model
from cruise.presets import TRACKS
from tests.export.conftest import policy_of


def ahead(env):
    """An observation of no kind of ours: the next gate from behind, and how crowded it is."""

    def observe(state):
        course = env.course_of(state)
        centre = course.position_w[:, state.next_gate]
        near = jnp.exp(-jnp.abs(state.drones.position_w)).sum(axis=0)
        parts = [centre - state.drones.position_w, env.dynamics.rotation(state.drones)[0], near[None]]
        return jnp.concatenate([*parts, jnp.zeros((49, *near.shape))])

    return observe


def mean_gate(env):
    """One that needs to know how many gates there are."""

    def observe(state):
        course = env.course_of(state)
        mean = sum(course.position_w[:, gate] for gate in range(course.num_gates))
        return jnp.concatenate(
            [
                mean.reshape(3, *(1,) * state.next_gate.ndim) - state.drones.position_w,
                jnp.zeros((53, *state.next_gate.shape)),
            ]
        )

    return observe


@pytest.mark.parametrize(("declared", "gates"), [(ahead, "G"), (mean_gate, "5")])
def test_an_observation_of_ones_own(declared, gates):
    policy = policy_of("shipped")
    env = export_env(policy, TRACKS["ring"])
    env = env._replace(observe_as=env.observe_as | {"extended": declared(env)})
    model = make_model(policy, env, "state")
    sizes = {port.name: port.shape for port in model.inputs}
    assert sizes["gate_yaw"] == (gates,)
    data = onnx_model(model, make_contract(policy, TRACKS["ring"], env, "state", model))
    draw = np.random.default_rng(0)
    known = {"B": 4, "M": 3, "G": 5}
    inputs = {}
    for port in model.inputs:
        shape = tuple(int(axis) if axis.isdigit() else known[axis] for axis in port.shape)
        if port.type == "float32":
            inputs[port.name] = draw.normal(size=shape).astype(np.float32)
        else:
            inputs[port.name] = draw.integers(0, 2, shape).astype(port.type)
    (given,) = onnxruntime.InferenceSession(data).run(["action"], inputs)
    parts = make_parts(policy, env)
    for row, action in enumerate(given):
        one = {name: rows if name.startswith("gate_") else rows[row] for name, rows in inputs.items()}
        values = {name: jnp.asarray(value).T for name, value in one.items()} | {"gate_size": jnp.ones((2, 5))}
        wanted = parts.whole(values)["action"]
        np.testing.assert_allclose(action, wanted, atol=1e-5)


@pytest.mark.parametrize("others", [0, 2, 6])
def test_the_nearest_others_in_the_air(others):
    draw = np.random.default_rng(others)
    place, speed = (draw.normal(size=(others, 3)).astype(np.float32) for _ in range(2))
    here = draw.random(others) < 0.7
    own = draw.normal(size=3).astype(np.float32)
    names = ("others_position_w", "others_velocity_w", "others_airborne", "position_w")
    values = dict(zip(names, map(jnp.asarray, (place, speed, here, own)), strict=True))
    cut = nearest_others(values, 3)
    order = sorted(np.flatnonzero(here), key=lambda k: np.linalg.norm(place[k] - own))[:3]
    seen = np.asarray(cut["others_airborne"])
    assert seen.sum() == len(order)
    np.testing.assert_array_equal(np.asarray(cut["others_position_w"])[: len(order)], place[order])
    np.testing.assert_array_equal(np.asarray(cut["others_velocity_w"])[: len(order)], speed[order])
