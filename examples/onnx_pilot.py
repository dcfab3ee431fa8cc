"""Any ONNX network as a pilot: what it sees and what its output means is said here, not in the file.

    cruise export ring-2 --network --onnx policy.onnx
    PILOT_MODEL=policy.onnx cruise race --track ring --drones 2 --pilot examples/onnx_pilot.py:Pilot

A model that `cruise export` wrote needs no such file: `--pilot policy.onnx` flies it. This is for networks of your own,
exported from PyTorch, say. It needs onnxruntime: pip install onnx onnxruntime.
"""

import os

import numpy as np
import onnxruntime


class Pilot:
    """One object for all drones of all races: the network is asked once a step."""

    name = "ONNX network"
    agility = 7.5  # with which it was trained
    observation = "extended"  # it sees this, and speaks in the frame of its target gate

    def __init__(self):
        model = os.environ.get("PILOT_MODEL", "policy.onnx")
        self.session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
        self.takes = self.session.get_inputs()[0].name

    def act_batch(self, view):
        """[M, O] observations to [M, 3] actions."""
        return self.session.run(None, {self.takes: view.observation.astype(np.float32)})[0]
