"""Where the drone is, as an estimator tells it: one JSON object a datagram, on the loopback."""

import json
import math
import socket
from typing import Any, NamedTuple

import numpy as np

from cruise.errors import CruiseError

SIZES = {"position_w": 3, "velocity_w": 3, "attitude": 4, "angular_velocity_b": 3}
MOST_BYTES = 2048
FARTHEST = 1e4  # of any number: beyond it nothing is a drone's
LENGTH_ERROR = 0.05  # of a quaternion


class Odometry(NamedTuple):
    """A state in SI units; world frame z up, body frame x forward, y left, z up."""

    time: float  # when it was so, by the clock CLOCK_MONOTONIC of this machine [s]
    position_w: np.ndarray  # [3] m
    velocity_w: np.ndarray  # [3] m/s
    attitude: np.ndarray  # [4] unit quaternion (w, x, y, z), body to world
    angular_velocity_b: np.ndarray  # [3] rad/s


def parse(data: bytes) -> Odometry:
    """The state in a datagram. Raises ValueError, saying why, where it is none."""
    try:
        told: Any = json.loads(data)
    except (ValueError, RecursionError):
        raise ValueError("no JSON") from None
    if not isinstance(told, dict):
        raise ValueError("no JSON object")
    vectors = [_numbers(told.get(name), size, name) for name, size in SIZES.items()]
    (time,) = _numbers([told.get("time")], 1, "time")
    length = float(np.linalg.norm(vectors[2]))
    if abs(length - 1) > LENGTH_ERROR:
        raise ValueError("attitude is no unit quaternion")
    return Odometry(float(time), vectors[0], vectors[1], vectors[2] / length, vectors[3])


def _numbers(value: Any, size: int, name: str) -> np.ndarray:
    if not isinstance(value, list) or len(value) != size:
        raise ValueError(f"{name} is not a list of {size}")
    limit = math.inf if name == "time" else FARTHEST
    if any(isinstance(one, bool) or not isinstance(one, int | float) or not abs(one) < limit for one in value):
        raise ValueError(f"{name} is not finite")
    return np.array(value, float)


class Receiver:
    """The newest state that came, and how many datagrams were none."""

    def __init__(self, port: int) -> None:
        """Listen on a port of the loopback; 0: any. Raises CruiseError where it is taken."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise CruiseError(f"cannot listen for odometry on UDP port {port}: {error}; choose another") from None
        self.port: int = self._socket.getsockname()[1]
        self.newest: Odometry | None = None
        self.refused = 0
        self.last_fault = ""

    def poll(self, now: float) -> Odometry | None:
        """The newest state until `now` [s]; what is older than another, or of the future, counts for nothing."""
        for _ in range(1000):
            try:
                data = self._socket.recv(MOST_BYTES + 1)
            except BlockingIOError:
                break
            try:
                self._take(data, now)
            except ValueError as fault:
                self.refused, self.last_fault = self.refused + 1, str(fault)
        return self.newest

    def _take(self, data: bytes, now: float) -> None:
        if len(data) > MOST_BYTES:
            raise ValueError("too long")
        state = parse(data)
        if state.time > now + 0.01:
            raise ValueError("time is in the future: it must be CLOCK_MONOTONIC of this machine")
        if self.newest is not None and state.time <= self.newest.time:
            raise ValueError("time does not go on")
        self.newest = state

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()
