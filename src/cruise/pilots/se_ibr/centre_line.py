"""The closed curve through a track's gates along which progress is measured, and the corridor around it."""

import functools
import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from cruise.config import Gate, Track
from cruise.racing.clearance import clearance
from cruise.racing.solids import outlines
from cruise.racing.ways import ways
from cruise.vector import dot

SPACING = 0.03  # of the table's samples, about [m]
FEWEST, MOST = 256, 200_000  # samples
HALF_CORRIDOR = 1.5  # half width and half height of the corridor away from gates [m]
NARROWEST = 0.05  # half width or half height of the corridor beside a solid in whose way it lies [m]
UPRIGHT = 0.05  # level part of a unit tangent below which a curve is upright
NARROWS = 3.0  # within this distance of a gate the corridor narrows to its opening [m]
NEWTON_STEPS, LONGEST_STEP = 3, 1.0  # of a projection [m]
START_BEHIND, START_BEYOND = 25.0, 1.0  # a drone at the start is looked for from here before its gate to beyond it [m]
START_CANDIDATES = 128


class CentreLine(NamedTuple):
    """A closed curve as a table over arc length, and NumPy so that it is a constant wherever it is used.

    At every sample the frame is the tangent, a horizontal normal to the left, and their cross product, which points up.
    """

    point_w: np.ndarray  # [3, M] m
    tangent_w: np.ndarray  # [3, M]
    left_w: np.ndarray  # [3, M]
    up_w: np.ndarray  # [3, M]
    half: np.ndarray  # [2, M] half width and half height of the corridor [m]
    curvature: np.ndarray  # [M] 1/m
    gate_progress: np.ndarray  # [G] arc length at which the gates stand [m]
    length: float  # of a lap [m]

    @property
    def spacing(self) -> float:
        """Arc length between two samples [m]."""
        return self.length / self.point_w.shape[1]


class Frame(NamedTuple):
    """The centre line at a progress."""

    point_w: Float[Array, "3 *B"]  # [m]
    tangent_w: Float[Array, "3 *B"]
    left_w: Float[Array, "3 *B"]
    up_w: Float[Array, "3 *B"]
    half: Float[Array, "2 *B"]  # [m]


@functools.lru_cache(maxsize=32)
def make_centre_line(track: Track) -> CentreLine:
    """The curve through the gates of a track, tangent to their normals."""
    pieces = ways(track)
    point, tangent = (np.concatenate(rows) for rows in zip(*pieces, strict=True))
    curvature = np.concatenate([piece.curvature for piece in pieces])
    steps = np.linalg.norm(np.diff(point, axis=0), axis=1)  # none from the end of a way to the start of the next
    progress = np.concatenate([[0.0], np.cumsum(steps)])
    length = float(progress[-1])
    samples = min(max(math.ceil(length / SPACING), FEWEST), MOST)
    s = np.arange(samples) * length / samples
    tangent = _unit(_resample(s, progress, tangent))
    left = _level_left(tangent)
    point, up = _resample(s, progress, point), np.cross(tangent, left)
    ends = np.cumsum([len(piece.point_w) for piece in pieces])
    gate_progress = progress[np.concatenate([[0], ends[:-1]])]
    return CentreLine(
        point_w=_rows(point),
        tangent_w=_rows(tangent),
        left_w=_rows(left),
        up_w=_rows(up),
        half=_beside_solids(track, point, _corridor(track, s, gate_progress, length)),
        curvature=np.interp(s, progress, curvature).astype(np.float32),
        gate_progress=gate_progress.astype(np.float32),
        length=length,
    )


def _corridor(track: Track, s: np.ndarray, gate_progress: np.ndarray, length: float) -> np.ndarray:
    """[2, M] half sizes: a gate's opening at the gate, `HALF_CORRIDOR` away from all gates, smooth between."""
    gates = len(gate_progress)
    around = np.concatenate([gate_progress[-1:] - length, gate_progress, gate_progress[:1] + length])
    after = np.searchsorted(around, s, side="right")
    nearest = after - (s - around[after - 1] < around[after] - s)
    opening = np.array([_free(gate) for gate in track.gates])[(nearest - 1) % gates].T
    blend = 0.5 - 0.5 * np.cos(np.pi * np.clip(np.abs(s - around[nearest]) / NARROWS, 0.0, 1.0))
    return (opening + blend * (HALF_CORRIDOR - opening)).astype(np.float32)


def _free(gate: Gate) -> tuple[float, float]:
    """Half width and half height of the largest level rectangle of the opening's proportions within it [m]."""
    half_width, half_height = gate.width / 2, gate.height / 2
    if gate.shape == "round":
        return half_width / math.sqrt(2), half_width / math.sqrt(2)
    cos, sin = abs(math.cos(gate.roll)), abs(math.sin(gate.roll))
    across, upward = half_width * cos + half_height * sin, half_width * sin + half_height * cos
    share = min(half_width / across, half_height / upward)
    return share * half_width, share * half_height


def _beside_solids(track: Track, point: np.ndarray, half: np.ndarray) -> np.ndarray:
    """The corridor [2, M], narrowed beside poles and walls so that it ends at them, and at the box of the track."""
    width, height = half.astype(np.float64)
    low, high = np.array(track.bounds_low), np.array(track.bounds_high)
    walls = np.minimum(point[:, :2] - low[:2], high[:2] - point[:, :2]).min(axis=1)
    width, height = (
        np.minimum(one, np.maximum(room, NARROWEST)) for one, room in ((width, walls), (height, high[2] - point[:, 2]))
    )
    for solid in outlines(track.obstacles):
        beside, above = clearance(solid, tuple(point.T))
        meets = (beside < width) & (above < height)
        width = np.where(meets & (beside >= above), np.maximum(beside, NARROWEST), width)
        height = np.where(meets & (beside < above), np.maximum(above, NARROWEST), height)
    return np.stack([width, height]).astype(np.float32)


def _level_left(tangent: np.ndarray) -> np.ndarray:
    """[M, 3] level normals to the left; where the curve is upright, the last one before, at right angles to it."""
    left = np.stack([-tangent[:, 1], tangent[:, 0], np.zeros(len(tangent))], axis=1)
    level = np.linalg.norm(left, axis=1) > UPRIGHT
    if not level.all():
        last = np.maximum.accumulate(np.where(level, np.arange(len(level)), -1))
        left = left[np.where(last < 0, np.flatnonzero(level)[-1] if level.any() else 0, last)]
        left = left - (left * tangent).sum(axis=1, keepdims=True) * tangent
    return _unit(left)


def frame_at(line: CentreLine, progress: Float[Array, "*B"]) -> Frame:
    """Point, axes and corridor at a progress, which may be any number of laps [m]."""
    index = _index(line, progress)
    return Frame(*(jnp.asarray(table)[:, index] for table in line[:5]))


def project(
    line: CentreLine, position_w: Float[Array, "3 *B"], near: Float[Array, "*B"], steps: int = NEWTON_STEPS
) -> Float[Array, "*B"]:
    """Progress of the curve's point nearest to a position, looked for from `near` on [m].

    The search is local, so where the curve crosses itself it stays on its branch; laps are counted on.
    """
    table = jnp.asarray(np.concatenate([line.point_w, line.tangent_w]))
    for _ in range(steps):
        here = table[:, _index(line, near)]
        along = dot(here[3:], position_w - here[:3])
        near = near + jnp.clip(along, -LONGEST_STEP, LONGEST_STEP)
    return near


def start_progress(line: CentreLine, position_w: Float[Array, "3 *B"], gate: Int[Array, "*B"]) -> Float[Array, "*B"]:
    """Progress of the nearest point on the way to `gate`, a little beyond it included [m]."""
    at_gate = jnp.asarray(line.gate_progress)[gate]
    behind = min(START_BEHIND, line.length / 2)
    offsets = jnp.linspace(-behind, START_BEYOND, START_CANDIDATES).reshape(-1, *(1,) * gate.ndim)
    point = frame_at(line, at_gate + offsets).point_w
    away = position_w[:, None] - point
    nearest = jnp.argmin(dot(away, away), axis=0)
    return project(line, position_w, at_gate + offsets.reshape(-1)[nearest])


def _index(line: CentreLine, progress: Float[Array, "*B"]) -> Int[Array, "*B"]:
    """The nearest sample."""
    return jnp.round(progress / line.spacing).astype(jnp.int32) % line.point_w.shape[1]


def _resample(s: np.ndarray, progress: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(s, progress, column) for column in rows.T], axis=1)


def _unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def _rows(table: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(table.T, dtype=np.float32)
