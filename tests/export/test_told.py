"""A vehicle told an attitude: its policy exported, and flown as a controller of the LSY course."""

import dataclasses
import sys
import types

import jax
import numpy as np
import onnxruntime
import pytest
from scipy.spatial.transform import Rotation

from cruise.cli.main import main
from cruise.config import Pole
from cruise.env.race_env import make_race_env
from cruise.errors import CruiseError
from cruise.export.c_harness import compiler, run_header
from cruise.export.c_header import prefix_of
from cruise.export.files import Exporter
from cruise.export.lsy import check_lsy
from cruise.pilots.network import NetworkShape
from cruise.presets import TRACKS, VEHICLES
from cruise.storage.policy_file import Policy, save_policy
from cruise.vehicles import load_vehicle
from tests.export.conftest import policy_of
from tests.storage.policies import meta, random_network

LSY = load_vehicle("examples/vehicles/lsy-course.toml")
TRACK = TRACKS["lsy-2"]


def policy(vehicle=LSY, track="lsy-2", observation="body-placed"):
    """Random, and loud enough that actions are clipped; of one drone."""
    env = make_race_env(TRACKS[track], 1, vehicle, observation)
    size = jax.eval_shape(env.observe, jax.eval_shape(env.reset, jax.random.key(0))).shape[0]
    params = jax.tree.map(lambda x: 3 * x, random_network(NetworkShape(size, vehicle.action.size, (8, 8))))
    return Policy(meta(track, 1, observation, vehicle=vehicle, agility=vehicle.agility, name="told"), params)


@pytest.fixture(scope="module")
def exporter():
    return Exporter.of(policy(), TRACK)


def test_commands_are_what_the_vehicle_declares(exporter, tmp_path):
    """In their units, from the action in [-1, 1]: by ONNX, and by C where there is a compiler."""
    action, recording = LSY.action, exporter.recording
    session = onnxruntime.InferenceSession(exporter.onnx(tmp_path / "told.onnx").path)
    inputs = dict(recording.inputs, next_gate=recording.inputs["next_gate"].astype(np.int64))
    names = [port.name for port in session.get_outputs()]
    assert names == ["action", *(one.name for one in action.numbers)]
    said, *told = session.run(names, inputs)
    low, high = (np.array([getattr(one, end) for one in action.numbers]) for end in ("low", "high"))
    wanted = low + (high - low) * (said + 1) / 2
    np.testing.assert_allclose(np.stack(told, axis=1), wanted, atol=1e-4)
    if compiler() is not None:
        exporter.c(tmp_path / "told.h")
        run = run_header((tmp_path / "told.h").read_text(), prefix_of(exporter.policy), recording, tmp_path)
        np.testing.assert_allclose(run.command, wanted, atol=1e-4)


@pytest.mark.parametrize("base", ["racer", "paper"])
def test_a_place_to_fly_to_is_an_offset_in_metres(base, tmp_path):
    """In the world's frame; what CRUISE's own loop makes of it goes into the next step, the policy's observation."""
    vehicle = dataclasses.replace(VEHICLES[base], control="position")
    exporter = Exporter.of(policy(vehicle, "ring", "body"), TRACKS["ring"])
    recording, reach = exporter.recording, vehicle.tracking.reach
    offset = np.column_stack([recording.outputs[f"offset_{axis}"] for axis in "xyz"])
    np.testing.assert_allclose(offset, reach * recording.outputs["action"], atol=1e-5)
    assert "previous_action" not in recording.inputs
    assert recording.inputs["previous_tracking"].shape[1] == vehicle.own.action.size
    assert exporter.onnx(tmp_path / "p.onnx").difference <= 1e-5
    if compiler() is not None:
        assert exporter.c(tmp_path / "p.h").difference <= 1e-5


class Config:
    """What the controller reads of theirs."""

    def __init__(self, control_mode):
        self.env = types.SimpleNamespace(control_mode=control_mode)


@pytest.fixture
def controller(exporter, tmp_path, monkeypatch):
    """The class in the exported file, with their base class in its place."""
    base = types.ModuleType("lsy_drone_racing.control")
    base.Controller = type("Controller", (), {"__init__": lambda self, obs, info, config: None})
    monkeypatch.setitem(sys.modules, "lsy_drone_racing", types.ModuleType("lsy_drone_racing"))
    monkeypatch.setitem(sys.modules, "lsy_drone_racing.control", base)
    path = exporter.lsy(tmp_path / "controller.py").path
    space = {}
    exec(compile(path.read_text(), str(path), "exec"), space)
    return space["CruiseController"]


def test_the_controller_says_in_their_words_what_the_policy_does(controller, exporter):
    """Quaternions with the real part last, newtons, and the actions of one flight one after the other."""
    recording = exporter.recording
    rows = recording.inputs
    gates = Rotation.from_euler("z", [[gate.yaw] for gate in TRACK.gates]).as_quat()
    one = controller({}, {}, Config("attitude"))
    for row in range(0, 40):
        obs = {
            "pos": rows["position_w"][row],
            "vel": rows["velocity_w"][row],
            "quat": np.roll(rows["attitude"][row], -1),
            "ang_vel": rows["angular_velocity_b"][row],
            "target_gate": rows["next_gate"][row],
            "gates_pos": np.array([gate.position_w for gate in TRACK.gates]),
            "gates_quat": gates,
            "obstacles_pos": np.array([pole.base_w for pole in TRACK.obstacles if isinstance(pole, Pole)]),
        }
        one._previous = {"previous_action": rows["previous_action"][row][None]}
        roll, pitch, yaw, newtons = one.compute_control(obs)
        wanted = {name: recording.outputs[name][row] for name in ("roll", "pitch", "yaw", "collective_thrust")}
        np.testing.assert_allclose([roll, pitch, yaw], [wanted[name] for name in ("roll", "pitch", "yaw")], atol=1e-4)
        assert newtons == pytest.approx(LSY.mass * wanted["collective_thrust"], abs=1e-4)
    assert one.step_callback(None, obs, 0.0, False, False, {}) is False
    with pytest.raises(ValueError, match="control_mode"):
        controller({}, {}, Config("state"))


def test_who_cannot_be_exported_so_is_told_so(tmp_path, capsys):
    with pytest.raises(CruiseError, match="does not tell its vehicle 'racer' roll, pitch and yaw"):
        check_lsy(policy_of("agile-alone"))
    saved = policy()
    save_policy(tmp_path / "policy", saved.params, saved.meta)
    assert main(["export", str(tmp_path / "policy.safetensors"), "--lsy", str(tmp_path / "c.txt")]) == 2
    assert "--lsy must name a .py file" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.py"))
