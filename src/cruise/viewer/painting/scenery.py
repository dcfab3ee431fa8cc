"""What stands on a track, as flat patches in space: frames of gates, poles and walls."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cruise import geometry
from cruise.config import Gate, Track
from cruise.racing.motion import gates_at, poses
from cruise.racing.shapes import ROUND, opening
from cruise.racing.solids import Outline, outlines
from cruise.storage.log_track import gates_of, solids_of
from cruise.storage.race_log import RaceLog

PATCH = 1.0  # large faces are cut into pieces of about this size, each of which has one depth [m]
MOST_CUTS = 40  # of a face along one side
SPARE = 0.9  # that a view leaves above gates [m]
TALLEST = 2.5  # solids are looked for no higher than this above the highest gate [m]


class Scenery(NamedTuple):
    """A track to be drawn."""

    gates: tuple[Gate, ...]
    frame_width: float  # [m]
    solids: tuple[Outline, ...]

    def at(self, time: float) -> "Scenery":
        """As it is at a time [s], nothing moving."""
        return self._replace(gates=gates_at(self.gates, time))


class Patch(NamedTuple):
    """A flat piece of a solid."""

    corners_w: np.ndarray  # [P, 3] m
    normal_w: np.ndarray  # [3] out of the solid


def track_scenery(track: Track) -> Scenery:
    """Of a track."""
    return Scenery(track.gates, track.frame_width, tuple(outlines(track.obstacles)))


def log_scenery(log: RaceLog) -> Scenery:
    """Of the track that a race was flown on."""
    return Scenery(gates_of(log), log.frame_width, solids_of(log))


def beams(gate: Gate, inner: float, outer: float) -> Iterator[np.ndarray]:
    """The border of a gate between two distances from its opening, in pieces of four corners [4, 3]."""
    inside, outside = opening(gate, inner), opening(gate, outer)
    for k in range(len(inside)):
        after = (k + 1) % len(inside)
        yield np.stack([outside[k], outside[after], inside[after], inside[k]])


def feet(gate: Gate, frame_width: float) -> np.ndarray:
    """Where lines to the ground begin: the lower corners of a frame, the sides of a round one [2, 3]."""
    rim = opening(gate, frame_width / 2)
    if gate.shape == "round":
        return rim[[0, ROUND // 2]]
    return rim[np.argsort(rim[:, 2], kind="stable")[:2]]


def patches(solid: Outline) -> list[Patch]:
    """The faces of a solid, without that on the ground."""
    return list(_cylinder(solid) if solid.shape == "cylinder" else _box(solid))


def _box(solid: Outline) -> Iterator[Patch]:
    half = np.array(solid.size) / 2
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = sign * np.eye(3)[axis]
            if normal[2] < 0:
                continue
            across, along = ((axis + 1) % 3, (axis + 2) % 3)
            for a0, a1 in _cuts(half[across]):
                for b0, b1 in _cuts(half[along]):
                    corners = np.tile(normal * half, (4, 1))
                    corners[:, across], corners[:, along] = (a0, a1, a1, a0), (b0, b0, b1, b1)
                    yield _placed(solid, corners, normal)


def _cylinder(solid: Outline) -> Iterator[Patch]:
    radius, half = solid.size[0] / 2, solid.size[2] / 2
    angle = 2 * np.pi * np.arange(ROUND // 2 + 1) / (ROUND // 2)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    for k in range(len(angle) - 1):
        middle = (angle[k] + angle[k + 1]) / 2
        for low, high in _cuts(half):
            side = np.array(
                [[x[k], y[k], low], [x[k + 1], y[k + 1], low], [x[k + 1], y[k + 1], high], [x[k], y[k], high]]
            )
            yield _placed(solid, side, np.array([np.cos(middle), np.sin(middle), 0.0]))
    yield _placed(solid, np.stack([x, y, np.full_like(x, half)], axis=1)[:-1], np.array([0.0, 0.0, 1.0]))


def _cuts(half: float) -> list[tuple[float, float]]:
    ends = np.linspace(-half, half, min(max(1, round(2 * half / PATCH)), MOST_CUTS) + 1)
    return list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))


def _placed(solid: Outline, corners: np.ndarray, normal: np.ndarray) -> Patch:
    heading = geometry.heading_of(solid.yaw)
    turned = [np.stack(geometry.from_gate(heading, tuple(vectors.T)), axis=-1) for vectors in (corners, normal)]
    return Patch(np.array(solid.centre_w) + turned[0], turned[1])


def must_be_seen(scenery: Scenery) -> np.ndarray:
    """Points that a view of the whole shows: gates with numbers above them, down to the ground, and solids [P, 3]."""
    gates = [pose for gate in scenery.gates for pose in poses(gate)]
    rims = np.concatenate([opening(gate, scenery.frame_width) for gate in gates])
    above = np.stack([[*gate.position_w[:2], opening(gate)[:, 2].max() + SPARE] for gate in gates])
    parts = [rims, above, rims * (1.0, 1.0, 0.0)]
    for solid in scenery.solids:
        corners = np.concatenate([patch.corners_w for patch in patches(solid)])
        corners[:, 2] = corners[:, 2].clip(0.0, rims[:, 2].max() + TALLEST)
        parts += [corners, corners * (1.0, 1.0, 0.0)]
    return np.concatenate(parts)
