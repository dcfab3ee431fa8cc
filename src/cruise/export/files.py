"""Exports as files. Each is compared with the policy on recorded races before it is written."""

import os
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cruise.config import Track
from cruise.env.race_env import RaceEnv
from cruise.errors import CruiseError
from cruise.export.c_harness import compiler, run_header
from cruise.export.c_header import c_header, prefix_of
from cruise.export.contract import export_env, make_contract
from cruise.export.lsy import check_lsy, lsy_controller
from cruise.export.onnx_policy import onnx_model
from cruise.export.pilot_program import Model, make_model
from cruise.export.recording import Recording, record
from cruise.storage.atomic import write_atomically
from cruise.storage.onnx_file import PREVIOUS, Interface, load_runtime
from cruise.storage.policy_file import Policy

TOLERANCE = 1e-5  # of actions, which are in [-1, 1]
COARSER = {"tracking": 10.0}  # what is made of the action by gains
CALLS = 2000  # measured

StrPath = str | os.PathLike[str]


@dataclass(frozen=True)
class Exported:
    """A written file."""

    path: Path
    size: int  # [bytes]
    difference: float | None  # largest from JAX in any action; None where no compiler was there to tell
    steps: int  # recorded and compared
    seconds_per_call: float | None  # for one drone, where it was measured


@dataclass(frozen=True)
class Exporter:
    """A policy, with races recorded on a track to compare exports with."""

    policy: Policy
    track: Track
    env: RaceEnv
    model: Model  # the whole pilot
    recording: Recording  # of what goes into that

    @classmethod
    def of(cls, policy: Policy, track: Track) -> "Exporter":
        """Record the races. Raises CruiseError where the policy cannot be exported, or does not fit the track."""
        env = export_env(policy, track)
        model, recording = make_model(policy, env, "state"), record(env, policy.pilot())
        inputs = {port.name: recording.inputs[port.name] for port in model.inputs}
        outputs = {port.name: recording.outputs[port.name] for port in model.outputs}
        return cls(policy, track, env, model, recording._replace(inputs=inputs, outputs=outputs))

    def onnx(self, path: StrPath, interface: Interface = "state", measure: bool = False) -> Exported:
        """Write an ONNX model.

        Args:
            path: of the file.
            interface: `state`: SI units in, world-frame action out; `observation`: the bare network.
            measure: how long onnxruntime takes for one drone on one core.

        Raises:
            CruiseError: a library is missing, the model does not do as the policy does, or the file cannot be written.
        """
        data, difference = self._compared(interface)
        inputs, wanted = self.expected(interface)
        seconds = _time_onnx(data, inputs) if measure else None
        write_atomically(Path(path), data)
        return Exported(Path(path), len(data), difference, len(wanted["action"]), seconds)

    def lsy(self, path: StrPath) -> Exported:
        """Write a controller of the LSY drone racing course, the ONNX model within it.

        Raises:
            CruiseError: as `onnx` does, and where the course has no use for the policy.
        """
        check_lsy(self.policy)
        model, difference = self._compared("state")
        data = lsy_controller(self.policy, self.track, self.model.inputs, model).encode()
        write_atomically(Path(path), data)
        return Exported(Path(path), len(data), difference, len(self.recording.observation), None)

    def _compared(self, interface: Interface) -> tuple[bytes, float]:
        """An ONNX model and how far it is from the policy. Raises CruiseError where that is too far."""
        model = self.model if interface == "state" else make_model(self.policy, self.env, interface)
        data = onnx_model(model, make_contract(self.policy, self.track, self.env, interface, model))
        session = load_runtime().InferenceSession(data, providers=["CPUExecutionProvider"])
        inputs, wanted = self.expected(interface)
        difference = _difference(dict(zip(wanted, session.run([*wanted], inputs), strict=True)), wanted)
        _require_equal(difference, "the ONNX model")
        return data, difference

    def c(self, path: StrPath, measure: bool = False) -> Exported:
        """Write a C99 header; it is compiled and compared where there is a compiler.

        Args:
            path: of the file.
            measure: how long the compiled header takes for one drone.

        Raises:
            CruiseError: it does not compile or do as the policy does, or the file cannot be written.
        """
        header = c_header(self.policy, self.track, self.env, self.recording)
        difference, seconds = None, None
        if compiler() is not None or measure:
            with tempfile.TemporaryDirectory() as folder:
                run = run_header(header, prefix_of(self.policy), self.recording, Path(folder), measure)
            difference, seconds = _difference(run.said, self.recording.said), run.seconds_per_call
            _require_equal(difference, "the C header")
        data = header.encode()
        write_atomically(Path(path), data)
        return Exported(Path(path), len(data), difference, len(self.recording.observation), seconds)

    def expected(self, interface: Interface) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """What goes into the model, and what must come out, commands apart, row by row."""
        recording = self.recording
        if interface == "observation":
            memory = {name: recording.outputs[name] for name in ("memory",) if name in recording.outputs}
            before = {f"{PREVIOUS}{name}": recording.inputs[f"{PREVIOUS}{name}"] for name in memory}
            return {"observation": recording.observation} | before, {"action": recording.network} | memory
        inputs = dict(recording.inputs)
        return inputs | {"next_gate": inputs["next_gate"].astype(np.int64)}, recording.said


def _difference(given: dict[str, np.ndarray], wanted: dict[str, np.ndarray]) -> float:
    return max(float(np.abs(given[name] - rows).max()) / COARSER.get(name, 1.0) for name, rows in wanted.items())


def _require_equal(difference: float, what: str) -> None:
    if not difference <= TOLERANCE:
        raise CruiseError(f"{what} differs from the policy by {difference:.2g}, more than {TOLERANCE:g}: not written")


def _time_onnx(data: bytes, inputs: dict[str, np.ndarray]) -> float:
    runtime = load_runtime()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = 1
    session = runtime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    one = {name: value if name.startswith(("gate_", "pole_")) else value[:1] for name, value in inputs.items()}
    taken = []
    for _ in range(CALLS):
        began = time.perf_counter()
        session.run(["action"], one)
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)  # warming up and what else the machine does are left out
