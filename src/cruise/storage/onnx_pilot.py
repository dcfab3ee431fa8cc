"""The pilot that flies an exported policy in onnxruntime."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cruise.env.observation import check_observation, for_any_field
from cruise.errors import CruiseError, one_line
from cruise.pilots.foreign import ForeignPilot
from cruise.pilots.view import View
from cruise.storage.onnx_file import PREVIOUS, Contract, StrPath, contract_of, first_action, open_model


def load_onnx_pilot(path: StrPath, budget: float) -> ForeignPilot:
    """An exported policy as a pilot that asks onnxruntime. Raises CruiseError where the file is not sound.

    The model is data: no file beside it is read, no custom operator is loaded.
    """
    session = open_model(path)
    contract = contract_of(session, path)
    meta = contract.policy
    observation = meta.observation if contract.interface == "observation" else None
    if observation:
        check_observation(f"policy {meta.name!r} in {path}", observation)

    def make() -> Any:
        return (_Network if observation else _Whole)(session, contract, str(path)).act_batch

    return ForeignPilot(make, "batch", meta.name, meta.agility, meta.vehicle, observation, budget)


class FedBack:
    """Outputs that a model is told of again at the next step: its action, its memory."""

    def __init__(self, contract: Contract) -> None:
        """Nothing was said yet."""
        told = [port for port in contract.inputs if port.name.startswith(PREVIOUS)]
        first = {port.name: port.first or first_action(contract.policy) for port in told}
        self.first = {name: np.array(numbers, np.float32) for name, numbers in first.items()}
        self.last = self.first

    def inputs(self, begins: np.ndarray) -> dict[str, np.ndarray]:
        """By name [M, K]; what comes before the first step for those of M whose race `begins`."""
        return {name: np.where(begins[:, None], self.first[name], last) for name, last in self.last.items()}

    @property
    def outputs(self) -> list[str]:
        """Names of the action and of all others that are to be kept."""
        return list(dict.fromkeys(["action", *(name.removeprefix(PREVIOUS) for name in self.first)]))

    def keep(self, said: dict[str, np.ndarray]) -> None:
        """What the model said in this step."""
        self.last = {name: said[name.removeprefix(PREVIOUS)] for name in self.first}


class _Network:
    """The bare network, which sees the observation."""

    def __init__(self, session: Any, contract: Contract, path: str) -> None:
        """`contract` belongs to the policy in `session`."""
        self.session, self.contract, self.meta, self.path = session, contract, contract.policy, path
        self.fed_back = FedBack(contract)

    def act_batch(self, view: View) -> np.ndarray:
        """Actions [M, A] in the frame of the observation."""
        self._check_field(view)
        return self._asked(self._recalled(view) | {"observation": np.asarray(view.observation, np.float32)})

    def _recalled(self, view: View) -> dict[str, np.ndarray]:
        return self.fed_back.inputs(np.asarray(view.time) == 0)

    def _asked(self, *batches: dict[str, np.ndarray]) -> np.ndarray:
        """Actions of all batches, one below the other."""
        outputs = self.fed_back.outputs
        rows = zip(*(self._run(outputs, inputs) for inputs in batches), strict=True)
        said = dict(zip(outputs, map(np.concatenate, rows), strict=True))
        self.fed_back.keep(said)
        return said["action"]

    def _run(self, outputs: list[str], inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
        try:
            given: list[np.ndarray] = self.session.run(outputs, inputs)
            return given
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
    """The whole pilot, which sees the state in SI units."""

    def __init__(self, session: Any, contract: Contract, path: str) -> None:
        """`contract` belongs to the policy in `session`."""
        super().__init__(session, contract, path)
        self.takes = {port.name for port in contract.inputs}

    def act_batch(self, view: View) -> np.ndarray:
        """Actions [M, A] in the vehicle's own frame."""
        self._check_field(view)
        self._check_gates(view)
        floats = ("position_w", "velocity_w", "euler", "angular_velocity_b", "others_position_w", "others_velocity_w")
        inputs = {name: getattr(view, name).astype(np.float32) for name in floats}
        inputs |= self._recalled(view) | {
            "next_gate": np.asarray(view.next_gate, np.int64),
            "others_airborne": view.others_airborne,
            "gate_position_w": view.gates.position_w.astype(np.float32),
            "gate_yaw": view.gates.yaw.astype(np.float32),
            "gate_size": np.stack([view.gates.width, view.gates.height], axis=1).astype(np.float32),
            "gate_tilt": np.stack([view.gates.roll, view.gates.pitch], axis=1).astype(np.float32),
        }
        if "attitude" in self.takes:
            attitude = Rotation.from_matrix(view.rotation_wb).as_quat()  # (x, y, z, w)
            inputs["attitude"] = np.roll(attitude, 1, axis=-1).astype(np.float32)
        taken = {name: value for name, value in inputs.items() if name in self.takes}
        told = view.gates.yaw
        if told.ndim == 1:
            return self._asked(taken)
        # a model is told of one set of gates, and here every drone believes in its own
        return self._asked(
            *({name: _of_row(row, name, value) for name, value in taken.items()} for row in range(len(told)))
        )

    def _check_gates(self, view: View) -> None:
        if "pole_position_w" in self.takes:
            raise CruiseError(
                f"exported policy {self.meta.name!r} needs to be told where poles stand, which races here do not: fly "
                "the policy itself"
            )
        check_tilt(self.contract, bool(view.gates.roll.any() or view.gates.pitch.any()))


def check_tilt(contract: Contract, leans: bool) -> None:
    """Raises CruiseError where some gates lean and the model was exported for a track on which none do."""
    if leans and not any(gate.roll or gate.pitch for gate in contract.gates):
        raise CruiseError(
            f"exported policy {contract.policy.name!r} knows upright gates alone, and some here lean: export it for a "
            "track whose gates do (cruise export --track)"
        )


def _of_row(row: int, name: str, value: np.ndarray) -> np.ndarray:
    """Of the inputs of a batch those of one row, as a batch of one."""
    if name in ("gate_size", "gate_tilt"):
        return value
    return value[row] if name in ("gate_position_w", "gate_yaw") else value[[row]]
