"""A moment of a race in perspective: gates, poles, walls, trails and drones, painted from far to near."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from cruise.config import Gate
from cruise.viewer.painting import look, scenery
from cruise.viewer.painting.camera import Camera, Margins, fit_camera
from cruise.viewer.painting.ground import paint_ground
from cruise.viewer.painting.look import Colour, mix
from cruise.viewer.painting.scenery import Scenery

FINE = 2  # pixels are drawn so many times finer than they are shown
TRAIL_WIDTH = 0.0055  # of the picture's height
SPAN = 0.5  # of a drone [m]
LEAST = 0.048  # a drone is drawn at least so large, of the picture's height
LARGEST = 3.5  # times its size
ARM, ROTOR = 0.17, 0.085  # [m]
STRIP = 0.07  # of the light round an opening [m]
IN_FRONT = 1e-3  # the strip lies so much nearer than the frame [m]
LIGHT = np.array([0.35, -0.55, 0.76])  # where it comes from
CIRCLE = np.stack([f(np.linspace(0, 2 * np.pi, 14, endpoint=False)) for f in (np.cos, np.sin, np.zeros_like)], axis=1)


class Piece(NamedTuple):
    """A flat piece or a line of a picture, of one depth."""

    depth: float  # [m]
    pixels: list[tuple[float, float]]
    colour: Colour | int  # or the number of the gate whose strip it is
    width: int = 0  # of a line; 0: filled


class Drone(NamedTuple):
    """One drone at a moment."""

    number: int
    position_w: np.ndarray  # [3] m
    axes: np.ndarray  # [3, 3] rotation from body to world
    status: str  # "flying", "finished", or how its race ended
    trail_w: np.ndarray  # [K, 3] where it was, oldest first
    trail_age: np.ndarray  # [K] from 1, about to vanish, to 0


class Scene(NamedTuple):
    """A race's surroundings, and what of their picture does not change from moment to moment."""

    camera: Camera  # of the fine picture
    background: Image.Image  # fine
    pieces: tuple[Piece, ...]  # of solids, and of gates that stand still
    stage: Scenery


def make_scene(stage: Scenery, size: tuple[int, int], margins: Margins) -> Scene:
    """Prepare a track to be painted, all of it between margins [px]."""
    camera = fit_camera(scenery.must_be_seen(stage), size, margins)
    ground = Image.fromarray(paint_ground(camera, np.array([gate.position_w for gate in stage.gates])))
    fine = camera.scaled(FINE)
    pieces = list(_gates(fine, stage, [gate.motion is None for gate in stage.gates]))
    pieces += [piece for solid in stage.solids for patch in scenery.patches(solid) for piece in _patch(fine, patch)]
    return Scene(fine, ground.resize(fine.size, Image.Resampling.NEAREST), tuple(pieces), stage)


def paint_scene(scene: Scene, drones: Sequence[Drone], strips: Sequence[Colour], time: float) -> Image.Image:
    """The race at a time [s], as large as it is shown; `strips` are the colours of the gates' lights."""
    picture = scene.background.copy()
    draw = ImageDraw.Draw(picture)
    for drone in drones:
        for piece in _shadow(scene.camera, drone):
            _paint(draw, piece, strips)
    stage = scene.stage
    gates = _gates(scene.camera, stage.at(time), [gate.motion is not None for gate in stage.gates])
    moving = (piece for drone in drones for piece in (*_trail(scene.camera, drone), *_body(scene.camera, drone)))
    for piece in sorted((*scene.pieces, *gates, *moving), key=lambda piece: -piece.depth):
        _paint(draw, piece, strips)
    return picture.reduce(FINE)


def _paint(draw: ImageDraw.ImageDraw, piece: Piece, strips: Sequence[Colour]) -> None:
    colour = strips[piece.colour] if isinstance(piece.colour, int) else piece.colour
    if piece.width:
        draw.line(piece.pixels, fill=colour, width=piece.width)
    else:
        draw.polygon(piece.pixels, fill=colour)


def _points(pixels: np.ndarray) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in pixels]


def _gates(camera: Camera, stage: Scenery, wanted: Sequence[bool]) -> Iterator[Piece]:
    for number, gate in enumerate(stage.gates):
        if wanted[number]:
            yield from _gate(camera, gate, number, stage.frame_width)


def _gate(camera: Camera, gate: Gate, number: int, frame_width: float) -> Iterator[Piece]:
    """A frame with a strip of light, each beam at its own depth, and lines to the ground."""
    for inner, outer, colour in ((STRIP, max(frame_width, STRIP), look.GATE), (0.0, STRIP, number)):
        for beam in scenery.beams(gate, inner, outer):
            pixels, depth = camera.project(beam)
            yield Piece(float(depth.mean()) - IN_FRONT * (colour == number), _points(pixels), colour)
    for foot in scenery.feet(gate, frame_width):
        if foot[2] > 0:
            pixels, depth = camera.project(np.stack([foot, foot * [1, 1, 0]]))
            yield Piece(float(depth.max()), _points(pixels), mix(look.GATE, look.GROUND, 0.4), FINE)


def _patch(camera: Camera, patch: scenery.Patch) -> Iterator[Piece]:
    """A piece of a solid, lit from one side; none where it is turned away."""
    middle = patch.corners_w.mean(axis=0)
    if patch.normal_w @ (camera.position_w - middle) <= 0:
        return
    pixels, depth = camera.project(patch.corners_w)
    shade = 0.62 - 0.5 * max(0.0, float(patch.normal_w @ LIGHT))
    yield Piece(float(depth.mean()), _points(pixels), mix(look.SOLID, look.GROUND, shade))


def _trail(camera: Camera, drone: Drone) -> Iterator[Piece]:
    if len(drone.trail_w) < 2:
        return
    width = max(FINE, round(TRAIL_WIDTH * camera.size[1]))
    pixels, depth = camera.project(drone.trail_w)
    points, own = _points(pixels), look.colour_of(drone.number)
    for k, age in enumerate(drone.trail_age[:-1].tolist()):
        colour = mix(own, look.GROUND, 0.1 + 0.85 * max(0.0, age - 0.2) / 0.8)
        yield Piece(float(depth[k]), points[k : k + 2], colour, width)


def _shadow(camera: Camera, drone: Drone) -> Iterator[Piece]:
    place = drone.position_w
    rim = place * [1, 1, 0] + CIRCLE * 0.2 * _enlargement(camera, place)
    yield Piece(0.0, _points(camera.project(rim)[0]), look.SHADOW)
    if drone.status == "flying":
        plumb = camera.project(np.stack([place, place * [1, 1, 0]]))[0]
        yield Piece(0.0, _points(plumb), mix(look.GROUND, look.GATE, 0.5), 1)


def _enlargement(camera: Camera, place: np.ndarray) -> float:
    """How many times larger than life a drone is drawn."""
    share = SPAN * camera.focal / camera.project(place)[1] / camera.size[1]
    return float(np.clip(LEAST / share, 1.0, LARGEST))


def _body(camera: Camera, drone: Drone) -> Iterator[Piece]:
    """Four rotors on an X and a body, the front rotors in the drone's colour."""
    place, own = drone.position_w, look.colour_of(drone.number)
    own = {"flying": own, "finished": mix(own, look.GROUND, 0.65)}.get(drone.status, look.CRASHED)
    axes, depth = _enlargement(camera, place) * drone.axes, float(camera.project(place)[1])
    corners = ARM * np.array([[x, y, 0.0] for x in (1, -1) for y in (1, -1)]) / np.sqrt(2)
    arms = camera.project(place + corners @ axes.T)[0]
    for first, last in ((0, 3), (1, 2)):
        yield Piece(depth, _points(arms[[first, last]]), mix(look.ARMS, look.GROUND, 0.2), FINE * 2)
    for k, corner in enumerate(corners):
        rim = camera.project(place + (corner + [0, 0, 0.04] + ROTOR * CIRCLE) @ axes.T)[0]
        yield Piece(depth, _points(rim), mix(own, look.GROUND, 0.25) if k < 2 else mix(look.ARMS, own, 0.3))
    hull = camera.project(place + (CIRCLE * [0.12, 0.055, 0]) @ axes.T)[0]
    yield Piece(depth, _points(hull), own)
