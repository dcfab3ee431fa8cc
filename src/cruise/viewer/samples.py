"""The flight of one drone as compact text: quantised, differenced, deflated, in base64.

`viewer/src/data/samples.js` is the other end. Each column becomes whole numbers of its step, then differences from
sample to sample (the first from 0), zigzag-coded so that small ones of either sign are small, then 4 byte planes of
`count` bytes each, lowest byte first. Planes of equal bytes deflate to almost nothing.
"""

import base64
import zlib

import numpy as np

from cruise.errors import CruiseError

# time [s], position_w [m], velocity_w [m/s], attitude (quaternion w, x, y, z, body to world)
STEPS = np.array([1e-4, *[1e-3] * 3, *[1e-3] * 3, *[2.0**-15] * 4])
LARGEST = 2**30  # steps; differences then fit 32 bits


def pack_samples(time: np.ndarray, position_w: np.ndarray, velocity_w: np.ndarray, euler: np.ndarray) -> dict:
    """Pack T samples of one drone.

    Args:
        time: [T] s.
        position_w: [T, 3] m.
        velocity_w: [T, 3] m/s.
        euler: [T, 3] roll, pitch, yaw (ZYX), rad.

    Returns:
        `count` and `data`, as the page reads them.

    Raises:
        CruiseError: numbers too large to be a race.
    """
    columns = np.column_stack([time, position_w, velocity_w, quaternions(euler)]).astype(np.float64) / STEPS
    if np.abs(columns).max(initial=0.0) > LARGEST:
        raise CruiseError("a race that takes days or leads a thousand kilometres away cannot be replayed")
    steps = np.rint(columns).astype(np.int64)
    differences = np.diff(steps, axis=0, prepend=0)
    zigzag = ((differences << 1) ^ (differences >> 63)).astype("<u4")
    planes = np.ascontiguousarray(zigzag.T).view(np.uint8).reshape(len(STEPS), -1, 4).swapaxes(1, 2)
    return {"count": len(time), "data": base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode("ascii")}


def quaternions(euler: np.ndarray) -> np.ndarray:
    """[T, 4] w, x, y, z of attitudes [T, 3] (roll, pitch, yaw, ZYX), of the sign that changes least over time."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(euler.T / 2.0), np.cos(euler.T / 2.0)
    rotation = np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=1,
    )
    turned = (rotation[1:] * rotation[:-1]).sum(axis=1) < 0
    sign = np.cumprod(np.where(turned, -1.0, 1.0))
    rotation[1:] *= sign[:, None]
    return rotation
