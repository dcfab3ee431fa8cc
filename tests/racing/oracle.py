"""Gates and contacts by brute force: every segment sampled finely, plain NumPy, straight from the `Track`."""

from dataclasses import dataclass

import numpy as np

from cruise.config import Gate, Track

SAMPLES = 2001


@dataclass
class Segments:
    """Random flights of one step past the gates of a track: [3, M] and [M]."""

    start: np.ndarray
    end: np.ndarray
    target: np.ndarray

    @property
    def length(self) -> np.ndarray:
        return np.linalg.norm(self.end - self.start, axis=0)


@dataclass
class Met:
    """What brute force saw at the gates, [M]; `clear` where no verdict hangs on the last centimetre."""

    passed: np.ndarray
    missed: np.ndarray
    hit_frame: np.ndarray
    crossed: np.ndarray
    fraction: np.ndarray
    offset: np.ndarray
    clear: np.ndarray


def axes(gate: Gate) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors forward, left and up of a gate: the columns of Rz(yaw) Ry(pitch) Rx(roll), turn by turn."""
    forward, left, up = np.eye(3)
    for axis, angle in ((0, gate.roll), (1, gate.pitch), (2, gate.yaw)):
        about = np.eye(3)[axis]
        forward, left, up = (
            np.cos(angle) * v + np.sin(angle) * np.cross(about, v) + (1 - np.cos(angle)) * (about @ v) * about
            for v in (forward, left, up)
        )
    return forward, left, up


def beyond(gate: Gate, left: np.ndarray, up: np.ndarray) -> np.ndarray:
    """How far a point of a gate's plane is from its opening, negative inside."""
    if gate.shape == "round":
        return np.hypot(left, up) - gate.width / 2
    return np.maximum(np.abs(left) - gate.width / 2, np.abs(up) - gate.height / 2)


def along(start: np.ndarray, end: np.ndarray, samples: int = SAMPLES) -> np.ndarray:
    """Points of the segments, [S, 3, M]."""
    t = np.linspace(0.0, 1.0, samples)[:, None, None]
    return (1 - t) * start + t * end


def random_segments(track: Track, count: int, seed: int = 0) -> Segments:
    """From millimetres to 40 m, most of them through the neighbourhood of a gate; the target is often that gate."""
    rng = np.random.default_rng(seed)
    chosen = rng.integers(len(track.gates), size=count)
    centre = np.array([g.position_w for g in track.gates])[chosen].T
    sides = np.array([axes(g)[1] for g in track.gates])[chosen].T
    reach = rng.choice([1.2, 2.0, 7.0], count)
    through = centre + sides * rng.uniform(-1, 1, count) * reach
    through[2] += rng.uniform(-1, 1, count) * reach
    direction = rng.normal(size=(3, count))
    length, before = np.exp(rng.uniform(np.log(0.005), np.log(40), count)), rng.uniform(0, 1, count)
    motion = direction / np.linalg.norm(direction, axis=0) * length
    start = through - before * motion
    target = np.where(rng.random(count) < 0.7, chosen, rng.integers(len(track.gates), size=count))
    return Segments(start.astype(np.float32), (start + motion).astype(np.float32), target.astype(np.int32))


def meet(track: Track, segments: Segments, tolerance: float) -> Met:
    """Verdicts of dense sampling."""
    count = segments.target.size
    points = along(segments.start.astype(np.float64), segments.end.astype(np.float64))
    passed, missed, hit, crossed = (np.zeros(count, bool) for _ in range(4))
    fraction, offset, clear = np.zeros(count), np.zeros(count), np.ones(count, bool)
    for index, gate in enumerate(track.gates):
        ahead, back, sample, left, up = first_crossing(gate, points)
        offset_here = beyond(gate, left, up)
        border = tolerance + track.frame_width
        inside, within_frame, near = (offset_here <= edge for edge in (tolerance, border, 5.0))
        target = segments.target == index
        passed |= target & ahead & inside
        missed |= target & ahead & near & ~within_frame
        hit |= (ahead | back) & within_frame & ~inside
        crossed |= target & (ahead | back)
        fraction = np.where(target, sample, fraction)
        offset = np.where(target, offset_here, offset)
        for edge in (tolerance, border, 5.0):
            clear &= ~((ahead | back) & (np.abs(offset_here - edge) < 0.02))
    return Met(passed, missed, hit, crossed, fraction, offset, clear)


def first_crossing(gate: Gate, points: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of sampled segments [S, 3, M]: crossed ahead, crossed back, fraction, and where in the plane."""
    forward, left, up = axes(gate)
    offset = points - np.array(gate.position_w)[None, :, None]
    distance = np.einsum("k,skm->sm", forward, offset)
    changes = (distance[:-1] < 0) != (distance[1:] < 0)
    at = np.argmax(changes, axis=0)
    here = np.arange(points.shape[2])
    point = 0.5 * (offset[at, :, here] + offset[at + 1, :, here])  # [M, 3]
    ahead, back = changes.any(0) & (distance[0] < 0), changes.any(0) & (distance[0] >= 0)
    return ahead, back, (at + 0.5) / (points.shape[0] - 1), point @ left, point @ up
