"""ONNX models do in onnxruntime what the policy does in JAX, say what they are, and race."""

import dataclasses
import json

import numpy as np
import onnx
import onnxruntime
import pytest
from scipy.spatial.transform import Rotation

import cruise
from cruise.errors import CruiseError
from cruise.evaluation.pilot_choice import find_pilot, pilot_meta
from cruise.export import files
from cruise.export.c_harness import compiler, run_header
from cruise.export.c_header import c_header, prefix_of
from cruise.presets import TRACKS
from cruise.racing.track_file import load_track
from cruise.storage.onnx_file import read_contract
from cruise.storage.policy_file import save_policy
from cruise.storage.race_log import EventKind
from tests.export.conftest import ATOL, KINDS, lost_others, policy_of, track_of


@pytest.fixture(scope="module")
def models(exporters, tmp_path_factory):
    folder = tmp_path_factory.mktemp("onnx")
    paths = {}
    for kind in KINDS:
        for interface in ("state", "observation"):
            paths[kind, interface] = exporters(kind).onnx(folder / f"{kind}-{interface}.onnx", interface).path
    return paths


@pytest.mark.parametrize("kind", KINDS)
def test_the_whole_pilot_from_raw_state_to_action(kind, exporters, models):
    session = onnxruntime.InferenceSession(models[kind, "state"])
    recording = exporters(kind).recording
    inputs = dict(recording.inputs, next_gate=recording.inputs["next_gate"].astype(np.int64))
    names = [port.name for port in read_contract(models[kind, "state"]).outputs]
    assert set(names) == set(recording.outputs)
    outputs = dict(zip(names, session.run(names, inputs), strict=True))
    action = outputs["action"]
    for name, wanted in recording.outputs.items():
        np.testing.assert_allclose(outputs[name], wanted, atol=ATOL.get(name, 1e-4), err_msg=name)
    assert (np.abs(action) == 1).any()  # the clip is at work
    one = {name: value if name.startswith("gate_") else value[5:6] for name, value in inputs.items()}
    np.testing.assert_allclose(session.run(["action"], one)[0], action[5:6], atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_the_bare_network(kind, exporters, models):
    session = onnxruntime.InferenceSession(models[kind, "observation"])
    inputs, wanted = exporters(kind).expected("observation")
    assert {port.name for port in session.get_inputs()} == set(inputs)
    for given, name in zip(session.run([*wanted], inputs), wanted, strict=True):
        np.testing.assert_allclose(given, wanted[name], atol=1e-5, err_msg=name)


@pytest.mark.parametrize("kind", ["shipped", "agile", "agile-near", "paper"])
def test_who_left_the_air_may_be_anywhere(kind, exporters, models):
    """At no number: an estimator that has lost him."""
    session = onnxruntime.InferenceSession(models[kind, "state"])
    lost = lost_others(exporters(kind).recording)
    (action,) = session.run(["action"], dict(lost.inputs, next_gate=lost.inputs["next_gate"].astype(np.int64)))
    assert np.abs(action - lost.outputs["action"]).max() <= 1e-5


def agile_inputs(exporters, rows=slice(500)):
    recording = exporters("agile").recording
    inputs = dict(recording.inputs, next_gate=recording.inputs["next_gate"].astype(np.int64))
    return {name: value if name.startswith("gate_") else value[rows] for name, value in inputs.items()}


def test_a_quaternion_and_its_negative_are_one_attitude(exporters, models):
    session = onnxruntime.InferenceSession(models["agile", "state"])
    inputs = agile_inputs(exporters)
    here, there = (session.run(["action"], inputs | {"attitude": sign * inputs["attitude"]})[0] for sign in (1, -1))
    np.testing.assert_array_equal(here, there)


def test_an_agile_pilot_takes_any_number_of_others_in_any_order(exporters, models):
    """Three are seen: fewer are as if the rest had left the air, and more change nothing."""
    session = onnxruntime.InferenceSession(models["agile", "state"])
    inputs = agile_inputs(exporters)
    names = [name for name in inputs if name.startswith("others_")]

    def act(order, gone=()):
        changed = {name: inputs[name][:, list(order)] for name in names}
        changed["others_airborne"] = changed["others_airborne"].copy()
        changed["others_airborne"][:, list(gone)] = False
        return session.run(["action"], inputs | changed)[0]

    everybody = act(range(7))
    np.testing.assert_array_equal(everybody, act((3, 0, 6, 5, 1, 2, 4)))
    np.testing.assert_array_equal(act((0, 1)), act(range(7), gone=range(2, 7)))
    np.testing.assert_array_equal(act(()), act(range(7), gone=range(7)))
    np.testing.assert_array_equal(everybody, act((*range(7), *range(7)), gone=range(7)))
    assert np.abs(everybody - act(())).max() > 0.1


def test_turned_about_the_vertical_an_agile_pilot_flies_the_same(exporters, models):
    session = onnxruntime.InferenceSession(models["agile", "state"])
    inputs = agile_inputs(exporters)
    turn = Rotation.from_euler("z", 0.7)
    moved = dict(inputs, gate_yaw=inputs["gate_yaw"] + np.float32(0.7))
    attitude = (turn * Rotation.from_quat(np.roll(inputs["attitude"], -1, axis=1))).as_quat()
    moved["attitude"] = np.roll(attitude, 1, axis=1).astype(np.float32)
    for name in ("position_w", "velocity_w", "others_position_w", "others_velocity_w", "gate_position_w"):
        moved[name] = (inputs[name] @ turn.as_matrix().T).astype(np.float32)
    here, there = (session.run(["action"], values)[0] for values in (inputs, moved))
    np.testing.assert_allclose(there, here, atol=2e-4)


def test_gates_may_stand_elsewhere(exporters, models):
    """Moved and turned with everything else, the race is the same; `extended` sees nothing of the world but height."""
    session = onnxruntime.InferenceSession(models["alone", "state"])
    recording = exporters("alone").recording
    inputs = dict(recording.inputs, next_gate=recording.inputs["next_gate"].astype(np.int64))
    turn, shift = np.pi / 2, np.array([16.0, -8.0, 0.0], np.float32)  # a quarter, so that the clip turns with it
    rotation = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    moved = dict(inputs, gate_yaw=inputs["gate_yaw"] + np.float32(turn))
    for name in ("position_w", "velocity_w", "gate_position_w", "previous_action"):
        moved[name] = inputs[name] @ rotation.T + (shift if "position" in name else np.float32(0.0))
    moved["euler"] = inputs["euler"] + np.array([0, 0, turn], np.float32)
    here, there = (session.run(["action"], values)[0] for values in (inputs, moved))
    assert len(here) > 50
    assert np.abs(here - there).max() > 0.5
    np.testing.assert_allclose(there, here @ rotation.T, atol=2e-3)


def test_the_contract_says_everything(models):
    model = onnx.load(models["shipped", "state"])
    contract = json.loads({entry.key: entry.value for entry in model.metadata_props}["cruise"])
    assert contract == json.loads(json.dumps(contract, allow_nan=False))
    assert (contract["interface"], contract["control_dt"], contract["policy"]["agility"]) == ("state", 0.1, 7.5)
    for ports, found in ((contract["inputs"], model.graph.input), (contract["outputs"], model.graph.output)):
        assert [port["name"] for port in ports] == [value.name for value in found]
        for port, value in zip(ports, found, strict=True):
            shape = [str(axis.dim_value or axis.dim_param) for axis in value.type.tensor_type.shape.dim]
            assert shape == port["shape"]
            assert port["meaning"]
    assert {port["name"]: (port["unit"], port["frame"]) for port in contract["inputs"]}["velocity_w"] == (
        "m/s",
        "world",
    )
    entries = contract["observation"]
    assert [entry["first"] for entry in entries] == np.cumsum([0, *(e["size"] for e in entries[:-1])]).tolist()
    assert entries[-1]["first"] + entries[-1]["size"] == 56
    assert len(contract["gates"]) == 5
    assert model.opset_import[0].version <= 17
    read = read_contract(models["shipped", "state"])
    assert (read.policy.name, read.policy.drones, read.policy.track) == ("ring-4", 4, "ring")


@pytest.mark.parametrize("interface", ["state", "observation"])
def test_an_agile_file_flies_the_same_race_in_a_smaller_field(interface, models):
    path = str(models["agile", interface])
    flown, wanted = (cruise.race("ring", 2, pilot, laps=1, seed=2, vehicle="racer") for pilot in (path, "racer-ring"))
    length = min(len(flown.time), len(wanted.time), 100)
    np.testing.assert_allclose(flown.position_w[:length], wanted.position_w[:length], atol=2e-3)
    assert not (flown.event_kind == EventKind.COLLISION_DRONE).any()


@pytest.fixture(scope="module")
def flown_in_jax(tmp_path_factory):
    """Races of the policies themselves, by kind."""
    folder = tmp_path_factory.mktemp("policy")

    def flown(kind):
        policy = policy_of(kind)
        path = save_policy(folder / kind, policy.params, policy.meta)
        return cruise.race(track_of(kind), KINDS[kind][1], path, laps=1, seed=2)

    return {kind: flown(kind) for kind in ("alone", "told")}


@pytest.mark.parametrize("interface", ["state", "observation"])
@pytest.mark.parametrize("kind", ["alone", "told"])
def test_an_exported_file_flies_the_same_race(kind, interface, models, flown_in_jax):
    """What it has to be told of from step to step, its memory among it, is carried."""
    path, wanted = str(models[kind, interface]), flown_in_jax[kind]
    flown = cruise.race(track_of(kind), KINDS[kind][1], path, laps=1, seed=2)
    length = min(len(flown.time), len(wanted.time), 100)
    assert length > 5
    np.testing.assert_allclose(flown.position_w[:length], wanted.position_w[:length], atol=2e-3)
    assert pilot_meta(path).drones == KINDS[kind][1]


def broken(tmp_path, models, change):
    model = onnx.load(models["alone", "state"])
    change(model)
    onnx.save(model, tmp_path / "changed.onnx")
    return str(tmp_path / "changed.onnx")


def renamed(model):
    entry = next(entry for entry in model.metadata_props if entry.key == "cruise")
    entry.value = entry.value.replace('"velocity_w"', '"speed_w"')


def of_the_future(model):
    entry = next(entry for entry in model.metadata_props if entry.key == "cruise")
    entry.value = entry.value.replace('"format": 1', '"format": 9')


def without(model):
    del model.metadata_props[:]


def nonsense(model):
    model.metadata_props[0].value = "{"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            without,
            "was not exported by `cruise export`: nothing says what goes in and comes out; write a pilot around it",
        ),
        (renamed, "contract: inputs are position_w, speed_w, "),
        (of_the_future, "contract: format 9, this program reads 1"),
        (nonsense, "contract: not valid JSON"),
    ],
)
def test_damaged_models(change, message, models, tmp_path):
    path = broken(tmp_path, models, change)
    for ask in (find_pilot, pilot_meta):
        with pytest.raises(CruiseError) as error:
            ask(path)
        assert message in str(error.value)
        assert "\n" not in str(error.value)


def test_races_it_does_not_fit(models):
    with pytest.raises(CruiseError, match="'ring-4' was trained for races of 4 drones, this race has 2"):
        cruise.race("ring", 2, str(models["shipped", "state"]), laps=1)
    with pytest.raises(CruiseError, match="does not fit this race"):
        cruise.race("ring", 3, str(models["paper", "observation"]), laps=1)  # one gate fewer than it was trained with


def test_nothing_is_written_where_the_model_does_something_else(exporters, tmp_path, monkeypatch):
    monkeypatch.setattr(files, "TOLERANCE", 1e-12)
    with pytest.raises(
        CruiseError, match=r"the ONNX model differs from the policy by .*, more than 1e-12: not written"
    ):
        exporters("paper").onnx(tmp_path / "p.onnx")
    assert not list(tmp_path.iterdir())


def test_policies_that_cannot_be_exported():
    shipped = policy_of("shipped")
    for change, message in (
        ({"vehicle": "racer"}, "gives 3 numbers, but this vehicle's action has 4"),
        ({"observation": "body"}, "reads 56 numbers, but the 'body' observation has 58"),
        ({"drones": 2}, "reads 56 numbers, but the 'extended' observation has 38"),
    ):
        policy = dataclasses.replace(shipped, meta=dataclasses.replace(shipped.meta, **change))
        with pytest.raises(CruiseError) as error:
            files.Exporter.of(policy, TRACKS["ring"])
        assert message in str(error.value)
    with pytest.raises(CruiseError, match=r"'random' is another track in every race: choose the one .* \(--track\)"):
        files.Exporter.of(policy_of("agile-alone"), load_track("random"))
    with pytest.raises(CruiseError, match="gates that stand still, and those of 'moving' move"):
        files.Exporter.of(policy_of("agile-alone"), TRACKS["moving"])


def test_a_file_that_knows_upright_gates_alone_is_not_flown_through_others(models):
    """A gate that leans would be flown as an upright one; a round one looks as its square does to every policy."""
    first, *rest = TRACKS["ring"].gates
    leaning, in_circles = (
        dataclasses.replace(TRACKS["ring"], gates=(dataclasses.replace(first, **change), *rest))
        for change in ({"pitch": 0.3}, {"shape": "round"})
    )
    with pytest.raises(
        CruiseError, match=r"knows upright gates alone, and some here lean: .* \(cruise export --track\)"
    ):
        cruise.race(leaning, 4, str(models["shipped", "state"]), laps=1)
    flown, wanted = (cruise.race(track, 4, str(models["shipped", "state"]), laps=1) for track in (in_circles, "ring"))
    np.testing.assert_array_equal(flown.position_w[:20], wanted.position_w[:20])


@pytest.mark.parametrize("model", ["onnx", "c"])
def test_what_knows_leaning_gates_flies_through_upright_ones(model, exporters, models, tmp_path):
    """By the same file, as the policy does that is told of no tilt."""
    told, upright = exporters("told"), files.Exporter.of(policy_of("told"), TRACKS["ring"])
    inputs, wanted = upright.expected("state")
    assert "gate_tilt" not in inputs
    if model == "onnx":
        session = onnxruntime.InferenceSession(models["told", "state"])
        (action,) = session.run(["action"], inputs | {"gate_tilt": np.zeros((5, 2), np.float32)})
    elif compiler() is None:
        pytest.skip("no C compiler here")
    else:
        header = c_header(told.policy, TRACKS["ring"], told.env, upright.recording)
        assert "float tilt[2];" in header
        action = run_header(header, prefix_of(told.policy), upright.recording, tmp_path).said["action"]
    np.testing.assert_allclose(action, wanted["action"], atol=1e-5)
