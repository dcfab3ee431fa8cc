"""Rims of gates and outlines of solids as corners in space, for whoever draws them. Plain NumPy."""

import numpy as np

from cruise import geometry
from cruise.config import Gate
from cruise.racing.solids import Outline

ROUND = 32  # corners of what is round


def opening(gate: Gate, beyond: float = 0.0) -> np.ndarray:
    """The rim of an opening, or of its frame `beyond` [m] it, counter-clockwise as seen in flight [P, 3]."""
    half_width, half_height = gate.width / 2 + beyond, gate.height / 2 + beyond
    if gate.shape == "round":
        angle = 2 * np.pi * np.arange(ROUND) / ROUND
        left, up = half_width * np.cos(angle), half_width * np.sin(angle)
    else:
        left, up = (
            side * np.array(signs) for side, signs in ((half_width, (1, 1, -1, -1)), (half_height, (-1, 1, 1, -1)))
        )
    offset = geometry.from_gate(
        geometry.heading_of(gate.yaw), (np.zeros_like(left), left, up), geometry.tilt_of(gate.roll, gate.pitch)
    )
    return np.array(gate.position_w) + np.stack(offset, axis=1)


def footprint(solid: Outline) -> np.ndarray:
    """A solid from above, counter-clockwise [P, 2]."""
    if solid.shape == "cylinder":
        angle = 2 * np.pi * np.arange(ROUND) / ROUND
        x, y = solid.size[0] / 2 * np.cos(angle), solid.size[0] / 2 * np.sin(angle)
    else:
        x, y = (
            np.array(signs) * half / 2
            for signs, half in zip(((1, -1, -1, 1), (1, 1, -1, -1)), solid.size[:2], strict=True)
        )
    x, y, _ = geometry.from_gate(geometry.heading_of(solid.yaw), (x, y, 0.0))
    return np.array(solid.centre_w[:2]) + np.stack([x, y], axis=1)
