"""Exported policies: an ONNX model with its contract in the metadata, and the pilot that flies it in onnxruntime."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from cruise.env.observation import check_observation, for_any_field
from cruise.errors import CruiseError, one_line
from cruise.extras import import_extra
from cruise.pilots.foreign import ForeignPilot
from cruise.pilots.view import View
from cruise.storage.atomic import read_bytes
from cruise.storage.config_file import from_json
from cruise.storage.policy_file import PolicyMeta
from cruise.vehicles import find_vehicle

FORMAT_VERSION = 1
METADATA = "cruise"  # key of the contract in the model's metadata
Interface = Literal["state", "observation"]

StrPath = str | os.PathLike[str]


@dataclass(frozen=True)
class Port:
    """An input or output."""

    name: str
    shape: tuple[str, ...]  # B is the number of drones asked for at once
    type: str
    unit: str
    frame: str
    meaning: str


@dataclass(frozen=True)
class ObservationEntry:
    """Some numbers of the observation: a quantity over its scale, clipped to [low, high]."""

    name: str
    first: int
    size: int
    quantity: str
    unit: str
    scale: float
    frame: str
    low: float
    high: float


@dataclass(frozen=True)
class ExportedGate:
    """A gate of the track that the policy was trained on; world frame, z up."""

    position_w: tuple[float, float, float]  # [m]
    yaw: float  # heading of the direction of flight [rad]
    width: float  # [m]
    height: float  # [m]


@dataclass(frozen=True)
class Contract:
    """What one must know to fly an exported policy anywhere."""

    format: int
    interface: Interface  # state: SI units in, world-frame action out; observation: the bare network
    policy: PolicyMeta
    control_dt: float  # ask it once in this time [s]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    observation: tuple[ObservationEntry, ...]
    gates: tuple[ExportedGate, ...]  # empty where the track is not at hand


def read_contract(path: StrPath) -> Contract:
    """The contract of an exported model. Raises CruiseError where the file is none."""
    return _contract(open_model(path), path)


def read_onnx_meta(path: StrPath) -> PolicyMeta:
    """What the exported policy is. Raises CruiseError as `read_contract` does."""
    return read_contract(path).policy


def load_onnx_pilot(path: StrPath, budget: float) -> ForeignPilot:
    """An exported policy as a pilot that asks onnxruntime. Raises CruiseError where the file is not sound.

    The model is data: no file beside it is read, no custom operator is loaded.
    """
    session = open_model(path)
    contract = _contract(session, path)
    meta = contract.policy
    observation = meta.observation if contract.interface == "observation" else None
    if observation:
        check_observation(f"policy {meta.name!r} in {path}", observation)

    def make() -> Any:
        return (_Network if observation else _Whole)(session, meta, str(path)).act_batch

    return ForeignPilot(make, "batch", meta.name, meta.agility, meta.vehicle, observation, budget)


def open_model(path: StrPath) -> Any:
    """An onnxruntime session on one core. Raises CruiseError where onnxruntime or a sound model is missing."""
    data = read_bytes(Path(path), "model")
    runtime = load_runtime()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # the networks are small
    options.log_severity_level = 4  # errors are raised, not printed
    try:
        return runtime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # its exceptions have no common base
        raise CruiseError(f"model {path}: not a sound ONNX model ({one_line(error, 200)})") from None


def load_runtime() -> Any:
    """The module onnxruntime. Raises CruiseError where it is not installed."""
    return import_extra("onnxruntime", "onnx", "ONNX models need onnxruntime")


def _contract(session: Any, path: StrPath) -> Contract:
    text = session.get_modelmeta().custom_metadata_map.get(METADATA)
    if text is None:
        raise CruiseError(
            f"model {path} was not exported by `cruise export`: nothing says what goes in and comes out; "
            "write a pilot around it in Python, as examples/onnx_pilot.py does"
        )
    where = f"model {path}: contract"
    contract = from_json(text, Contract, where)
    if contract.format != FORMAT_VERSION:
        raise CruiseError(f"{where}: format {contract.format}, this program reads {FORMAT_VERSION}")
    for kind, ports, found in (
        ("inputs", contract.inputs, session.get_inputs()),
        ("outputs", contract.outputs, session.get_outputs()),
    ):
        names, named = [port.name for port in found], [port.name for port in ports]
        if names != named:
            raise CruiseError(f"{where}: {kind} are {', '.join(named)}, those of the model {', '.join(names)}")
    return contract


class _Network:
    """The bare network, which sees the observation."""

    def __init__(self, session: Any, meta: PolicyMeta, path: str) -> None:
        """`meta` belongs to the policy in `session`."""
        self.session, self.meta, self.path = session, meta, path

    def act_batch(self, view: View) -> np.ndarray:
        """Actions [M, A] in the frame of the observation."""
        self._check_field(view)
        return self._run({"observation": np.asarray(view.observation, np.float32)})

    def _run(self, inputs: dict[str, np.ndarray]) -> np.ndarray:
        try:
            return self.session.run(["action"], inputs)[0]
        except Exception as error:  # its exceptions have no common base
            raise CruiseError(
                f"policy {self.meta.name!r} in {self.path} does not fit this race: {one_line(error, 200)}"
            ) from None

    def _check_field(self, view: View) -> None:
        drones = view.others_position_w.shape[1] + 1
        if not for_any_field(self.meta.observation) and drones != self.meta.drones:
            raise CruiseError(
                f"policy {self.meta.name!r} was trained for races of {self.meta.drones} drones, this race has {drones}"
            )


class _Whole(_Network):
    """The whole pilot, which sees the state in SI units and remembers its last action."""

    def __init__(self, session: Any, meta: PolicyMeta, path: str) -> None:
        """Nothing was commanded yet."""
        super().__init__(session, meta, path)
        self.takes = {port.name for port in session.get_inputs()}
        self.first = np.array(first_action(meta), np.float32)
        self.previous = self.first

    def act_batch(self, view: View) -> np.ndarray:
        """Actions [M, A] in the vehicle's own frame."""
        self._check_field(view)
        self._check_gates(view)
        self.previous = np.where(np.asarray(view.time)[:, None] > 0, self.previous, self.first)
        floats = ("position_w", "velocity_w", "euler", "angular_velocity_b", "others_position_w", "others_velocity_w")
        inputs = {name: getattr(view, name).astype(np.float32) for name in floats}
        inputs |= {
            "previous_action": self.previous,
            "next_gate": np.asarray(view.next_gate, np.int64),
            "others_airborne": view.others_airborne,
            "gate_position_w": view.gates.position_w.astype(np.float32),
            "gate_yaw": view.gates.yaw.astype(np.float32),
            "gate_size": np.stack([view.gates.width, view.gates.height], axis=1).astype(np.float32),
        }
        if "attitude" in self.takes:
            attitude = Rotation.from_matrix(view.rotation_wb).as_quat()  # (x, y, z, w)
            inputs["attitude"] = np.roll(attitude, 1, axis=-1).astype(np.float32)
        taken = {name: value for name, value in inputs.items() if name in self.takes}
        told = view.gates.yaw
        if told.ndim == 1:
            self.previous = self._run(taken)
        else:  # a model is told of one set of gates, and here every drone believes in its own
            each = [{name: _of_row(row, name, value) for name, value in taken.items()} for row in range(len(told))]
            self.previous = np.concatenate([self._run(inputs) for inputs in each])
        return self.previous

    def _check_gates(self, view: View) -> None:
        gates = view.gates
        if "pole_position_w" in self.takes:
            raise CruiseError(
                f"exported policy {self.meta.name!r} needs to be told where poles stand, which races here do not: fly "
                "the policy itself"
            )
        if gates.roll.any() or gates.pitch.any() or gates.is_round.any():
            raise CruiseError(
                f"exported policy {self.meta.name!r} knows upright rectangular gates alone, and some here lean or are "
                "round: fly the policy itself"
            )


def _of_row(row: int, name: str, value: np.ndarray) -> np.ndarray:
    """Of the inputs of a batch those of one row, as a batch of one."""
    if name == "gate_size":
        return value
    return value[row] if name in ("gate_position_w", "gate_yaw") else value[[row]]


def first_action(meta: PolicyMeta) -> tuple[float, ...]:
    """What counts as the action before the first: the one that hovers."""
    return find_vehicle(meta.vehicle).action.neutral
