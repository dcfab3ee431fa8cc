"""The race itself: ground, gates, trails and drones, painted from far to near."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from cruise.storage.race_log import EventKind, RaceLog
from cruise.viewer.film import look
from cruise.viewer.film.camera import Camera
from cruise.viewer.film.flights import Flight, make_flight
from cruise.viewer.film.look import Colour, mix
from cruise.viewer.standings import Standing

FINE = 2  # pixels are drawn so many times finer than they are shown
TRAIL = 3.0  # [s]
TRAIL_PIECE = 1 / 15  # [s]
TRAIL_WIDTH = 0.0055  # of the picture's height
SPAN = 0.5  # of a drone [m]
LEAST = 0.048  # a drone is drawn at least so large, of the picture's height
GLOW = 0.9  # how long a gate keeps the colour of the drone that flew through [s]
ARM, ROTOR = 0.17, 0.085  # [m]
STRIP = 0.07  # [m]
CIRCLE = np.stack([f(np.linspace(0, 2 * np.pi, 14, endpoint=False)) for f in (np.cos, np.sin, np.zeros_like)], axis=1)

Painter = Callable[[ImageDraw.ImageDraw], object]


class Scene(NamedTuple):
    """What does not change from frame to frame."""

    log: RaceLog
    camera: Camera  # of the fine picture
    flights: tuple[Flight, ...]
    background: Image.Image  # fine


def make_scene(log: RaceLog, camera: Camera) -> Scene:
    """Prepare a race to be painted."""
    flights = tuple(make_flight(log, drone) for drone in range(log.num_drones))
    ground = Image.fromarray(paint_ground(log, camera))
    fine = camera.scaled(FINE)
    return Scene(log, fine, flights, ground.resize(fine.size, Image.Resampling.NEAREST))


def paint_scene(scene: Scene, t: float, order: list[Standing]) -> Image.Image:
    """The race at a time, as large as it is shown."""
    picture = scene.background.copy()
    draw = ImageDraw.Draw(picture)
    for shadow in _shadows(scene, t):
        shadow(draw)
    things = [*_gates(scene, t, order), *_trails(scene, t), *_drones(scene, t, order)]
    for _, paint in sorted(things, key=lambda thing: -thing[0]):
        paint(draw)
    return picture.reduce(FINE)


def paint_ground(log: RaceLog, camera: Camera) -> np.ndarray:
    """[H, W, 3] the ground with lines every metre and every five, which fades into the background."""
    width, height = camera.size
    across, down = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([(across - camera.middle[0]) / camera.focal, (camera.middle[1] - down) / camera.focal], axis=-1)
    rays = rays @ camera.axes[:2] - camera.axes[2]
    falling = np.minimum(rays[..., 2], -1e-4)
    place = camera.position_w[:2] - rays[..., :2] * (camera.position_w[2] / falling)[..., None]
    middle = log.gate_position[:, :2].mean(axis=0)
    radius = np.linalg.norm(log.gate_position[:, :2] - middle, axis=1).max() + 4.0
    away = np.linalg.norm(place - middle, axis=-1) / radius
    fade = 1 - _smooth(0.9, 3.2, away)
    grid = np.maximum(0.32 * _lines(place, 1.0), _lines(place, 5.0)) * (0.25 + 0.75 * fade) * (1 - _smooth(2, 5, away))
    colour = look.BACKGROUND + fade[..., None] * np.subtract(look.GROUND, look.BACKGROUND)
    return np.rint(colour + grid[..., None] * (look.GRID - colour)).astype(np.uint8)


def _lines(place: np.ndarray, step: float) -> np.ndarray:
    """How much of every pixel lines every `step` metres cover."""
    at = place / step
    pixel = np.abs(np.gradient(at, axis=0)) + np.abs(np.gradient(at, axis=1))
    distance = np.abs((at - 0.5) % 1.0 - 0.5) / np.maximum(pixel, 1e-9)
    return (np.clip(1.0 - distance, 0.0, 1.0) * (1 - _smooth(0.08, 0.35, pixel))).max(axis=-1)


def _smooth(low: float, high: float, x: np.ndarray) -> np.ndarray:
    s = np.clip((x - low) / (high - low), 0.0, 1.0)
    return s * s * (3 - 2 * s)


def _points(pixels: np.ndarray) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in pixels]


def _polygon(pixels: np.ndarray, colour: Colour) -> Painter:
    return lambda draw: draw.polygon(_points(pixels), fill=colour)


def _line(pixels: np.ndarray, colour: Colour, width: int) -> Painter:
    return lambda draw: draw.line(_points(pixels), fill=colour, width=width)


def _gates(scene: Scene, t: float, order: list[Standing]) -> Iterator[tuple[float, Painter]]:
    """Frames with a strip of light, each beam at its own depth."""
    log, camera = scene.log, scene.camera
    leader = next((row for row in order if row.status == "flying"), None)
    target = -1 if leader is None else (log.next_gate[0, 0] + leader.passed) % log.num_gates
    for gate in range(log.num_gates):
        strip = _glow(log, gate, t, look.HIGHLIGHT if gate == target else look.STRIP)
        for inner, outer, colour in ((STRIP, log.frame_width, look.GATE), (0.0, STRIP, strip)):
            for beam in _beams(log, gate, inner, outer):
                pixels, depth = camera.project(beam)
                yield float(depth.mean()) - 1e-3 * (colour is strip), _polygon(pixels, colour)
        feet = _beams(log, gate, 0.0, log.frame_width)[2][[0, 1]]
        for foot in feet:
            pixels, depth = camera.project(np.stack([foot, foot * [1, 1, 0]]))
            yield float(depth.max()), _line(pixels, look.GATE_DARK, FINE)


def _glow(log: RaceLog, gate: int, t: float, colour: Colour) -> Colour:
    """The colour of a gate's strip: for a moment that of the last drone that flew through."""
    through = np.flatnonzero((log.event_kind == EventKind.CROSSING) & (log.event_gate == gate) & (log.event_time <= t))
    if len(through) == 0:
        return colour
    since = (t - float(log.event_time[through[-1]])) / GLOW
    return mix(colour, look.colour_of(int(log.event_drone[through[-1]])), max(0.0, 1 - since**2))


def _beams(log: RaceLog, gate: int, inner: float, outer: float) -> list[np.ndarray]:
    """Left, right, lower and upper beam between two distances from the opening, each [4, 3]."""
    (width, height), yaw = log.gate_size[gate] / 2, log.gate_yaw[gate]
    left, up = np.array([-np.sin(yaw), np.cos(yaw), 0.0]), np.array([0.0, 0.0, 1.0])

    def patch(y0: float, y1: float, z0: float, z1: float) -> np.ndarray:
        corners = [(y0, z0), (y1, z0), (y1, z1), (y0, z1)]
        return log.gate_position[gate] + np.array([y * left + z * up for y, z in corners])

    w, h, a, b = width, height, inner, outer
    sides = [patch(w + a, w + b, -h - b, h + b), patch(-w - b, -w - a, -h - b, h + b)]
    return [*sides, patch(-w - a, w + a, -h - b, -h - a), patch(-w - a, w + a, h + a, h + b)]


def _trails(scene: Scene, t: float) -> Iterator[tuple[float, Painter]]:
    width = max(FINE, round(TRAIL_WIDTH * scene.camera.size[1]))
    for drone, flight in enumerate(scene.flights):
        times = np.arange(max(0.0, t - TRAIL), min(t, flight.end) + TRAIL_PIECE, TRAIL_PIECE).clip(
            max=min(t, flight.end)
        )
        if len(times) < 2:
            continue
        pixels, depth = scene.camera.project(flight.position_at(times))
        for k in range(len(times) - 1):
            age = (t - times[k]) / TRAIL
            colour = mix(look.colour_of(drone), look.GROUND, 0.1 + 0.85 * max(0.0, age - 0.2) / 0.8)
            yield float(depth[k]), _line(pixels[k : k + 2], colour, width)


def _shadows(scene: Scene, t: float) -> Iterator[Painter]:
    for flight in scene.flights:
        place = flight.position_at(t)
        rim = place * [1, 1, 0] + CIRCLE * 0.2 * _enlargement(scene.camera, place)
        yield _polygon(scene.camera.project(rim)[0], look.SHADOW)
        if t < flight.end:
            yield _line(
                scene.camera.project(np.stack([place, place * [1, 1, 0]]))[0], mix(look.GROUND, look.GATE, 0.5), 1
            )


def _enlargement(camera: Camera, place: np.ndarray) -> float:
    """How many times larger than life a drone is drawn."""
    share = SPAN * camera.focal / camera.project(place)[1] / camera.size[1]
    return float(np.clip(LEAST / share, 1.0, 3.5))


def _drones(scene: Scene, t: float, order: list[Standing]) -> Iterator[tuple[float, Painter]]:
    """Four rotors on an X and a body, the front rotors in the drone's colour."""
    for row in order:
        flight = scene.flights[row.drone]
        place, axes = flight.position_at(t), flight.axes_at(t)
        size = _enlargement(scene.camera, place)
        own = look.colour_of(row.drone) if row.status == "flying" else look.CRASHED
        if row.status == "finished":
            own = mix(look.colour_of(row.drone), look.GROUND, 0.65)
        depth = float(scene.camera.project(place)[1])
        for paint in _body(scene.camera, place, size * axes, own):
            yield depth, paint


def _body(camera: Camera, place: np.ndarray, axes: np.ndarray, own: Colour) -> Iterator[Painter]:
    corners = ARM * np.array([[x, y, 0.0] for x in (1, -1) for y in (1, -1)]) / np.sqrt(2)
    arms = camera.project(place + corners @ axes.T)[0]
    for first, last in ((0, 3), (1, 2)):
        yield _line(arms[[first, last]], mix(look.ARMS, look.GROUND, 0.2), FINE * 2)
    for k, corner in enumerate(corners):
        rim = place + (corner + [0, 0, 0.04] + ROTOR * CIRCLE) @ axes.T
        yield _polygon(camera.project(rim)[0], mix(own, look.GROUND, 0.25) if k < 2 else mix(look.ARMS, own, 0.3))
    hull = place + (CIRCLE * [0.12, 0.055, 0]) @ axes.T
    yield _polygon(camera.project(hull)[0], own)
