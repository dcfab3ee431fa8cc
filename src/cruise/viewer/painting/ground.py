"""The ground: lines every metre and every five, bright round the track, fading into the background."""

import numpy as np

from cruise.viewer.painting import look
from cruise.viewer.painting.camera import Camera

AROUND = 4.0  # of the bright part round the gates [m]


def paint_ground(camera: Camera, places_w: np.ndarray) -> np.ndarray:
    """[H, W, 3] uint8, bright round some places [P, 3]."""
    width, height = camera.size
    across, down = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack([(across - camera.middle[0]) / camera.focal, (camera.middle[1] - down) / camera.focal], axis=-1)
    rays = rays @ camera.axes[:2] - camera.axes[2]
    falling = np.minimum(rays[..., 2], -1e-4)
    place = camera.position_w[:2] - rays[..., :2] * (camera.position_w[2] / falling)[..., None]
    middle = places_w[:, :2].mean(axis=0)
    radius = np.linalg.norm(places_w[:, :2] - middle, axis=1).max() + AROUND
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
