"""Exported policies: an ONNX model with its contract in the metadata."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from cruise.errors import CruiseError, one_line
from cruise.extras import import_extra
from cruise.storage.atomic import read_bytes
from cruise.storage.config_file import from_json
from cruise.storage.policy_file import PolicyMeta
from cruise.vehicles import find_vehicle

FORMAT_VERSION = 1
PREVIOUS = "previous_"  # begins the name of an input that is an output of one control step before
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
    first: tuple[float, ...] = ()  # of an input that is an output of one control step before: what to give first


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
    roll: float = 0.0  # about the direction of flight [rad]
    pitch: float = 0.0  # of the direction of flight below the horizon [rad]


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
    return contract_of(open_model(path), path)


def read_onnx_meta(path: StrPath) -> PolicyMeta:
    """What the exported policy is. Raises CruiseError as `read_contract` does."""
    return read_contract(path).policy


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


def contract_of(session: Any, path: StrPath) -> Contract:
    """The contract of a model that is open. Raises CruiseError where it has none that fits it."""
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


def first_action(meta: PolicyMeta) -> tuple[float, ...]:
    """What counts as the action before the first: the one that hovers."""
    return find_vehicle(meta.vehicle).action.neutral
