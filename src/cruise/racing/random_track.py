"""Tracks drawn at random, each with a line that proves that it can be flown. Plain NumPy: no JAX.

Gates are put around a circle in an order that difficulty shuffles, at heights and headings that it spreads, some of
them one above the other, and tilted where that is asked for. Then the ways from gate to gate are computed, each tangent
to both normals; a track whose ways strike a frame, come near the ground or bend too sharply is thrown away, and the
next one drawn. Poles and walls are put last, near the ways but clear of them. What tilt and obstacles draw, they draw
from a stream of their own: without them a seed gives the track that it always gave.
"""

import dataclasses
import functools
import math

import numpy as np

from cruise import geometry
from cruise.config import Gate, Track, TrainConfig, Vec3
from cruise.errors import CruiseError
from cruise.racing.random_obstacles import MOST_OBSTACLES, with_obstacles
from cruise.racing.track_file import ANY, RANDOM, RANDOM_KINDS, load_track, track_faults
from cruise.racing.track_geometry import ACROSS, facing_away
from cruise.racing.ways import Way, way_between

MIN_GATES, MAX_GATES = 3, 40
SPACING = (11.0, 6.0)  # of neighbours around the circle, of the easiest and of the hardest tracks [m]
OPENINGS = (2.0, 1.5, 2.2, 1.7)  # width and height of gates, in turn [m]
LOWEST, HIGHEST = 1.0, 5.0  # of the centres of gates [m]
GAP = 0.25  # between the frames of gates that stand one above the other [m]
CLEARANCE = 0.4  # of the line from frames [m]
NEAREST_GROUND = 0.5  # of the line [m]
SHARPEST = 1.0  # bend of the line [1/m]
MARGIN = 12.0  # of the bounds around the gates [m]
CEILING = 15.0  # of the bounds [m]
AWAY = 6.0  # farther from all gates than the way between two of them: has left the track [m]
SAMPLES = 160  # of every way that is looked at, some 5 cm apart
ATTEMPTS = 1000
USUAL_GATES = 8
UNSEEN, TRAINING, MANY = 100, 500, 1000
EASE = 0.5  # of the tracks of `any`: what is hard to learn, gates one above the other, is rare on easy ones
SEEDS = 1000  # of the tracks of one seed of `random_tracks`
FRAME_WIDTH = 0.3  # [m]
STEEPEST_TILT = math.radians(60)


def random_track(
    seed: int, gates: int = USUAL_GATES, difficulty: float = 0.5, obstacles: int = 0, tilt: float = 0.0
) -> Track:
    """A track that can be flown; the same seed gives the same.

    Args:
        seed: 0 or more.
        gates: how many, from 3 to 40.
        difficulty: from 0, gates far apart around a circle and nearly level, to 1: close, shuffled, at any height up to
            5 m, turned away from the shortest way, and often in pairs, one above the other.
        obstacles: poles and walls, from 0 to 60, beside the ways from gate to gate.
        tilt: largest roll and pitch of gates, from 0 to 60 degrees [rad].

    Raises:
        CruiseError: a number out of range, or no such track was found.
    """
    if seed < 0:
        raise CruiseError(f"seed must be 0 or more, not {seed}")
    if not MIN_GATES <= gates <= MAX_GATES:
        raise CruiseError(f"a random track has from {MIN_GATES} to {MAX_GATES} gates, not {gates}")
    if not 0 <= difficulty <= 1:
        raise CruiseError(f"difficulty must be from 0 to 1, not {difficulty}")
    if not 0 <= obstacles <= MOST_OBSTACLES:
        raise CruiseError(f"a random track has from 0 to {MOST_OBSTACLES} obstacles, not {obstacles}")
    if not 0 <= tilt <= STEEPEST_TILT:
        raise CruiseError(f"tilt must be from 0 to {math.degrees(STEEPEST_TILT):g} degrees, not {math.degrees(tilt):g}")
    drawn_from = [seed, gates, round(1e6 * difficulty)]
    rng, tilts = np.random.default_rng(drawn_from), np.random.default_rng([*drawn_from, round(1e6 * tilt)])
    for _ in range(ATTEMPTS):
        track = _track(f"random-{seed}", _tilted(tilts, _gates(rng, gates, difficulty), tilt))
        if not track_faults(track) and _faces_the_flight(track) and is_flyable(track):
            solids = np.random.default_rng([*drawn_from, round(1e6 * tilt), obstacles])
            return with_obstacles(solids, track, obstacles)
    raise CruiseError(f"no track of {gates} gates and difficulty {difficulty} was found from seed {seed}: try another")


def unseen_tracks(kind: str = RANDOM) -> Track:
    """The random tracks of a kind on which policies are measured: `UNSEEN` of them, that no training sees."""
    return random_tracks(0, UNSEEN, kind=kind)


def training_track(config: TrainConfig) -> Track:
    """The track of a run, which of `random` are others for every seed.

    Raises:
        CruiseError: as `load_track` does.
    """
    if config.track == ANY:
        return dataclasses.replace(random_tracks(config.seed + 1, MANY, kind=ANY, ease=EASE), reshaped=True)
    if config.track in RANDOM_KINDS:
        return random_tracks(config.seed + 1, TRAINING, kind=config.track)
    return load_track(config.track)


@functools.lru_cache(maxsize=4)
def random_tracks(seed: int, number: int, gates: int = USUAL_GATES, kind: str = RANDOM, ease: float = 1.0) -> Track:
    """One track of `number` variants, of evenly rising difficulty, of which every race gets one.

    `kind` is one of `RANDOM_KINDS`. Difficulty is an even share from 0 to 1 to the power of `ease`: below 1 there are
    more hard tracks than easy ones.
    """
    solids, tilt = RANDOM_KINDS[kind]
    shares = ((k + 0.5) / number for k in range(number))
    tracks = [random_track(SEEDS * seed + k, gates, share**ease, solids, tilt) for k, share in enumerate(shares)]
    every = _track(kind, tuple(gate for track in tracks for gate in track.gates))
    widest = max(track.leave_distance for track in tracks)
    return dataclasses.replace(
        every,
        gates=tracks[0].gates,
        leave_distance=widest,
        variants=tuple(track.gates for track in tracks),
        variant_obstacles=tuple(track.obstacles for track in tracks) if solids else (),
    )


def _faces_the_flight(track: Track) -> bool:
    gates = dict(enumerate(track.gates))
    return not any(facing_away(gates, len(gates), ACROSS))


def is_flyable(track: Track) -> bool:
    """Whether the ways from gate to gate clear the ground and all frames, and bend gently."""
    gates = track.gates
    ways = (way_between(a, b, track.frame_width, SAMPLES) for a, b in zip(gates, gates[1:] + gates[:1], strict=True))
    return all(_is_clear(way, track) for way in ways)


def _is_clear(way: Way, track: Track) -> bool:
    high, gentle = way.point_w[:, 2].min() >= NEAREST_GROUND, way.curvature.max() <= SHARPEST
    return bool(high and gentle) and not any(_strikes(way, gate, track.frame_width) for gate in track.gates)


def _strikes(way: Way, gate: Gate, frame_width: float) -> bool:
    """Whether a way crosses the plane of a gate on its frame or nearer to it than `CLEARANCE`."""
    away = tuple((way.point_w - np.array(gate.position_w)).T)
    tilt = geometry.tilt_of(gate.roll, gate.pitch)
    forward, left, up = geometry.to_gate(geometry.heading_of(gate.yaw), away, tilt)
    is_round = True if gate.shape == "round" else None
    offset = geometry.beyond_opening(left, up, gate.width / 2, gate.height / 2, is_round)
    near = (offset > -CLEARANCE) & (offset < frame_width + CLEARANCE)
    crossed = (forward[:-1] < 0) != (forward[1:] < 0)
    return bool((crossed & (near[:-1] | near[1:])).any())


def _tilted(rng: np.random.Generator, gates: tuple[Gate, ...], tilt: float) -> tuple[Gate, ...]:
    """Gates rolled and pitched by up to `tilt` [rad] each."""
    if tilt == 0:
        return gates
    turns = rng.uniform(-tilt, tilt, (len(gates), 2)).round(3).tolist()
    return tuple(
        dataclasses.replace(gate, roll=roll, pitch=pitch) for gate, (roll, pitch) in zip(gates, turns, strict=True)
    )


def _gates(rng: np.random.Generator, number: int, difficulty: float) -> tuple[Gate, ...]:
    """Gates as they come, flyable or not."""
    place, stacked = _places(rng, number, difficulty)
    before, after = np.roll(place, 1, axis=0), np.roll(place, -1, axis=0)
    heading = np.array([_bisector(*three) for three in zip(before, place, after, strict=True)])
    heading += rng.uniform(-1.0, 1.0, number) * math.pi / 4 * difficulty
    for first in np.flatnonzero(stacked):
        into, out = place[first] - place[first - 1], place[(first + 2) % number] - place[first]
        heading[first], heading[first + 1] = (math.atan2(y, x) + rng.uniform(-0.5, 0.5) for x, y, _ in (into, out))
    if rng.random() < 0.5:  # flown the other way round
        place, heading = place * (1.0, -1.0, 1.0), -heading
    sizes = [OPENINGS[k % len(OPENINGS)] for k in range(number)]
    return tuple(
        Gate(
            (round(float(x), 2), round(float(y), 2), round(float(z), 2)), round(math.remainder(yaw, math.tau), 3), s, s
        )
        for (x, y, z), yaw, s in zip(place, heading, sizes, strict=True)
    )


def _places(rng: np.random.Generator, number: int, difficulty: float) -> tuple[np.ndarray, np.ndarray]:
    """Centres [G, 3] and, by gate, whether the next one stands in the same place, lower or higher [G]."""
    order = np.arange(number)
    for _ in range(rng.integers(0, round(4 * difficulty), endpoint=True)):
        a, b = rng.choice(number, 2, replace=False)
        order[[a, b]] = order[[b, a]]
    spacing = (SPACING[0] + (SPACING[1] - SPACING[0]) * difficulty) * rng.uniform(0.5, 1.25)
    angle = 2 * np.pi * (order + rng.uniform(-0.3, 0.3, number) * (0.3 + difficulty)) / number
    out = spacing * number / (2 * np.pi) * rng.uniform(1 - 0.7 * difficulty, 1.0, number)
    highest = LOWEST + (HIGHEST - LOWEST) * rng.uniform(0.1, 0.3 + 0.7 * difficulty)
    place = np.column_stack([out * np.cos(angle), out * np.sin(angle), rng.uniform(LOWEST, highest, number)])
    stacked = np.zeros(number, bool)
    for k in range(0, number - 1, 2):
        if rng.random() < 0.5 * difficulty**2:
            stacked[k] = True
            apart = (OPENINGS[k % len(OPENINGS)] + OPENINGS[(k + 1) % len(OPENINGS)]) / 2 + 2 * FRAME_WIDTH + GAP
            low = rng.uniform(LOWEST, 1.5)
            falls = rng.random() < 0.75
            place[k + 1, :2] = place[k, :2]
            place[k, 2], place[k + 1, 2] = (low + apart, low) if falls else (low, low + apart)
    return place, stacked


def _bisector(before: np.ndarray, here: np.ndarray, after: np.ndarray) -> float:
    """Heading of the mean of the ways in and out."""
    into, out = here - before, after - here
    x, y, _ = into / max(np.linalg.norm(into), 1e-9) + out / max(np.linalg.norm(out), 1e-9)
    return math.atan2(y, x)


def _track(name: str, gates: tuple[Gate, ...]) -> Track:
    """Bounds far enough around the gates for any way between them."""
    places = np.array([gate.position_w for gate in gates])
    low, high = places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN
    legs = np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1)
    leave = round(float(legs.max()) / 2 + AWAY, 1)
    return Track(name, gates, _corner(low, 0.0), _corner(high, CEILING), frame_width=FRAME_WIDTH, leave_distance=leave)


def _corner(place: np.ndarray, height: float) -> Vec3:
    return round(float(place[0]), 1), round(float(place[1]), 1), height
