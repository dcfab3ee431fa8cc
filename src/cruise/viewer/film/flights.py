"""Where drones are between samples, by the same curves as on the replay page."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from cruise.storage.race_log import RaceLog


class Flight(NamedTuple):
    """One drone; it rests where its samples end."""

    end: float  # [s]
    position: CubicHermiteSpline | np.ndarray
    attitude: Slerp | Rotation

    def position_at(self, t: float | np.ndarray) -> np.ndarray:
        """[..., 3] m."""
        if isinstance(self.position, np.ndarray):
            return np.broadcast_to(self.position, (*np.shape(t), 3))
        return self.position(np.clip(t, 0.0, self.end))

    def axes_at(self, t: float) -> np.ndarray:
        """[3, 3] rotation from body to world."""
        if isinstance(self.attitude, Rotation):
            return self.attitude.as_matrix()
        return self.attitude(np.clip(t, 0.0, self.end)).as_matrix()


def make_flight(log: RaceLog, drone: int) -> Flight:
    """The flight of a drone up to where it finished or was out."""
    flown = slice(0, int(log.airborne[:, drone].sum()) + 1)
    time, position = log.time[flown], log.position_w[flown, drone].astype(np.float64)
    attitude = Rotation.from_euler("ZYX", log.euler[flown, drone, ::-1].astype(np.float64))
    if len(time) == 1:
        return Flight(0.0, position[0], attitude[0])
    curve = CubicHermiteSpline(time, position, log.velocity_w[flown, drone].astype(np.float64))
    return Flight(float(time[-1]), curve, Slerp(time, attitude))
