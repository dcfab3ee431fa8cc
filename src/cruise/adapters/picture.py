"""A race in perspective, quickly: Pillow draws it in a few milliseconds."""

from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from cruise.config import Gate, Track
from cruise.palette import drone_colour

if TYPE_CHECKING:
    from cruise.adapters.rendering import Frame

WIDTH, HEIGHT = 640, 480
FINE = 2  # drawn so many times larger, then reduced: smooth edges
SKY, GROUND, LINES, GATE, NEXT, INK = "#eef3f7", "#d9e0d3", "#c3ccbc", "#5b6470", "#d7263d", "#20262c"
ELEVATION, AZIMUTH = np.radians(32.0), np.radians(-62.0)  # of the camera, seen from the track
VIEW = np.radians(42.0)  # across the picture
ARM, ROTOR = 0.55, 0.38  # drones are drawn three times as large as they are [m]
SQUARE = 5.0  # of the ground [m]


class Camera:
    """Looks at a track so that all of it is in the picture."""

    def __init__(self, points_w: np.ndarray) -> None:
        """`points_w` [K, 3] shall be seen."""
        back = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
        right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
        self._axes = np.stack([right, np.cross(back, right), back])  # right, up, towards the camera
        self._focal = FINE * WIDTH / 2 / np.tan(VIEW / 2)
        middle = (points_w.min(axis=0) + points_w.max(axis=0)) / 2
        across, up, nearer = self._axes @ (points_w - middle).T
        half = FINE * np.array([WIDTH, HEIGHT]) / 2 * 0.94
        needed = np.maximum(np.abs(across) * self._focal / half[0], np.abs(up) * self._focal / half[1]) + nearer
        self._eye = middle + back * float(needed.max())

    def pixels(self, points_w: np.ndarray) -> list[tuple[float, float]]:
        """Where points [K, 3] are in the picture."""
        across, up, nearer = self._axes @ (np.asarray(points_w, np.float64) - self._eye).T
        depth = np.maximum(-nearer, 0.1)
        x = FINE * WIDTH / 2 + self._focal * across / depth
        y = FINE * HEIGHT / 2 - self._focal * up / depth
        return list(zip(x.tolist(), y.tolist(), strict=True))

    def distance(self, point_w: np.ndarray) -> float:
        """From the eye [m]."""
        return float(np.linalg.norm(point_w - self._eye))


class Painter:
    """Paints the races of a track."""

    def __init__(self, track: Track) -> None:
        """The ground is painted once."""
        corners = np.concatenate([_corners(gate, track.frame_width) for gate in track.gates])
        self.track = track
        self._low, self._high = corners[:, :2].min(axis=0) - 3.0, corners[:, :2].max(axis=0) + 3.0
        ground = [[x, y, 0.0] for x in (self._low[0], self._high[0]) for y in (self._low[1], self._high[1])]
        self.camera = Camera(np.concatenate([corners, ground]))
        self._empty = self._ground()
        self._font = ImageFont.load_default(size=13 * FINE)

    def paint(self, frame: "Frame", lines: list[str]) -> np.ndarray:
        """A picture [H, W, 3] uint8 of a race, with a line of text for every drone."""
        image = self._empty.copy()
        draw = ImageDraw.Draw(image)
        for drone in range(len(frame.position_w)):
            self._shadow(draw, frame, drone)
        following = int(frame.next_gate[0])
        things = [
            (self.camera.distance(np.array(gate.position_w)), "gate", k) for k, gate in enumerate(self.track.gates)
        ]
        things += [(self.camera.distance(place), "drone", k) for k, place in enumerate(frame.position_w)]
        for _, kind, k in sorted(things, reverse=True):
            if kind == "gate":
                self._gate(draw, self.track.gates[k], NEXT if k == following else GATE)
            else:
                self._drone(draw, frame, k)
        draw.text((10 * FINE, 8 * FINE), f"{self.track.name}   {frame.time:.1f} s", INK, self._font)
        for row, line in enumerate(lines):
            place = (10 * FINE, (28 + 17 * row) * FINE)
            draw.text(place, line, drone_colour(row), self._font)
        return np.asarray(image.reduce(FINE))

    def _ground(self) -> Image.Image:
        image = Image.new("RGB", (FINE * WIDTH, FINE * HEIGHT), SKY)
        draw = ImageDraw.Draw(image)
        (x0, y0), (x1, y1) = self._low, self._high
        draw.polygon(self.camera.pixels(np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])), fill=GROUND)
        for x in np.arange(np.ceil(x0 / SQUARE), x1 / SQUARE) * SQUARE:
            draw.line(self.camera.pixels(np.array([[x, y0, 0], [x, y1, 0]])), LINES, FINE)
        for y in np.arange(np.ceil(y0 / SQUARE), y1 / SQUARE) * SQUARE:
            draw.line(self.camera.pixels(np.array([[x0, y, 0], [x1, y, 0]])), LINES, FINE)
        return image

    def _gate(self, draw: ImageDraw.ImageDraw, gate: Gate, colour: str) -> None:
        outer, inner = (self.camera.pixels(_corners(gate, width)) for width in (self.track.frame_width, 0.0))
        for i in range(4):
            j = (i + 1) % 4
            draw.polygon([outer[i], outer[j], inner[j], inner[i]], fill=colour)

    def _shadow(self, draw: ImageDraw.ImageDraw, frame: "Frame", drone: int) -> None:
        place = frame.position_w[drone]
        turn = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
        ring = np.stack([ARM * np.cos(turn), ARM * np.sin(turn), np.zeros(16)], axis=1)
        draw.polygon(self.camera.pixels(ring + place * np.array([1.0, 1.0, 0.0])), fill="#aab3a2")
        foot = np.array([place, [place[0], place[1], 0.0]])
        draw.line(self.camera.pixels(foot), "#b9c1b2", FINE)

    def _drone(self, draw: ImageDraw.ImageDraw, frame: "Frame", drone: int) -> None:
        colour = drone_colour(drone)
        trail = self.camera.pixels(frame.trail[:, drone])
        for k in range(1, len(trail)):
            draw.line(trail[k - 1 : k + 1], _faded(colour, k / len(trail)), round(2.5 * FINE))
        if frame.out[drone]:
            x, y = self.camera.pixels(frame.position_w[drone : drone + 1])[0]
            for sign in (-1, 1):
                draw.line([(x - 6 * FINE, y - sign * 6 * FINE), (x + 6 * FINE, y + sign * 6 * FINE)], colour, 3 * FINE)
            return
        rotation = _rotation(*frame.euler[drone].tolist())
        turn = np.linspace(0.0, 2 * np.pi, 14, endpoint=False)
        disc = ROTOR * np.stack([np.cos(turn), np.sin(turn), np.zeros(14)], axis=1)
        hubs = ARM * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / np.sqrt(2)
        centre = frame.position_w[drone]
        arms = self.camera.pixels(centre + hubs @ rotation.T)
        for ends in ((arms[0], arms[2]), (arms[1], arms[3])):
            draw.line(ends, INK, 2 * FINE)
        for hub in hubs:
            draw.polygon(self.camera.pixels(centre + (hub + disc) @ rotation.T), fill=colour, outline=INK)


def _corners(gate: Gate, border: float) -> np.ndarray:
    """[4, 3] of the opening, `border` [m] wider on every side."""
    side = np.array([-np.sin(gate.yaw), np.cos(gate.yaw), 0.0]) * (gate.width / 2 + border)
    up = np.array([0.0, 0.0, gate.height / 2 + border])
    corners = np.array(gate.position_w) + np.array([side + up, -side + up, -side - up, side - up])
    corners[:, 2] = np.maximum(corners[:, 2], 0.0)
    return corners


def _rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """R_WB = Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _faded(colour: str, strength: float) -> tuple[int, int, int]:
    own, ground = np.array(ImageColor.getrgb(colour)[:3]), np.array(ImageColor.getrgb(GROUND)[:3])
    red, green, blue = (ground + strength * (own - ground)).round().astype(int).tolist()
    return red, green, blue
