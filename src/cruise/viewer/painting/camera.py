"""A camera that stands off a track and shows all of it."""

from typing import NamedTuple

import numpy as np

AZIMUTH, ELEVATION, FIELD = np.radians([-62.0, 30.0, 32.0])  # direction from the track to the camera, vertical angle
NEAREST = 1.0  # to what is to be seen [m]
ROUNDS = 60

Margins = tuple[float, float, float, float]  # at the left, top, right and bottom [px]


class Camera(NamedTuple):
    """A perspective picture of `size` pixels."""

    size: tuple[int, int]
    position_w: np.ndarray  # [3]
    axes: np.ndarray  # [3, 3] right, up and back in the world, row by row
    focal: float  # [px]
    middle: np.ndarray  # [2] where the axis of view meets the picture [px]

    def project(self, points_w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels [..., 2] and depths [...] of points [..., 3]."""
        seen = (np.asarray(points_w) - self.position_w) @ self.axes.T
        depth = np.asarray(np.maximum(-seen[..., 2], 0.05))
        return self.middle + self.focal * seen[..., :2] * (1.0, -1.0) / depth[..., None], depth

    def scaled(self, factor: float) -> "Camera":
        """The same view with `factor` times as many pixels."""
        size = (round(self.size[0] * factor), round(self.size[1] * factor))
        return self._replace(size=size, focal=self.focal * factor, middle=self.middle * factor)


def fit_camera(points_w: np.ndarray, size: tuple[int, int], margins: Margins) -> Camera:
    """A camera that shows points [P, 3] as large as the space between margins allows."""
    left, top, right, bottom = margins
    free = np.array([size[0] - left - right, size[1] - top - bottom])
    middle = np.array([left, top]) + free / 2
    focal = size[1] / 2 / np.tan(FIELD / 2)
    flat = np.cos(ELEVATION)
    back = np.array([np.cos(AZIMUTH) * flat, np.sin(AZIMUTH) * flat, np.sin(ELEVATION)])
    side = np.cross([0.0, 0.0, 1.0], back)
    axes = np.stack([side / np.linalg.norm(side), np.cross(back, side / np.linalg.norm(side)), back])
    aim = points_w.mean(axis=0)
    reach = max(float(np.linalg.norm(points_w - aim, axis=1).max()), NEAREST)
    distance = 4 * reach
    for _ in range(ROUNDS):
        camera = Camera(size, aim + distance * back, axes, focal, middle)
        pixels, depth = camera.project(points_w)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        offset = ((low + high) / 2 - middle) * (1.0, -1.0) * depth.mean() / focal
        aim = aim + offset[0] * axes[0] + offset[1] * axes[1]
        nearest = float(((points_w - aim) @ back).max()) + NEAREST  # nothing comes to lie behind the camera
        distance = max(nearest, distance * (0.3 + 0.7 * float(((high - low) / free).max())))
    return Camera(size, aim + distance * back, axes, focal, middle)
