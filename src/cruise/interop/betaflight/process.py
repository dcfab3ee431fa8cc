"""One firmware process in lock-step: nothing moves but from a request to its reply."""

import os
import socket
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cruise.errors import CruiseError
from cruise.interop.betaflight.firmware import find_firmware, find_shim

RUN, FORK = 0, 1
CHANNELS = 16
REQUEST = np.dtype(  # `from_host` in shim.c: head, state, sticks
    [
        ("run_ns", "<u8"),
        ("what", "u1"),
        ("has_state", "u1"),
        ("has_rc", "u1"),
        ("pad", "V5"),
        ("time", "<f8"),  # [s]
        ("rates", "<f8", 3),  # x forward, y right, z down [rad/s]
        ("force", "<f8", 3),  # as far as an accelerometer does not feel it, x forward, y left, z up [m/s^2]
        ("attitude", "<f8", 4),
        ("unused", "<f8", 6),
        ("pressure", "<f8"),  # [Pa]
        ("rc_time", "<f8"),
        ("rc", "<u2", CHANNELS),  # [us]
    ]
)
REPLY = np.dtype(  # `to_host`
    [
        ("now_ns", "<u8"),
        ("sent", "<u4"),
        ("pid", "<u4"),
        ("port", "<u4"),
        ("pad", "V4"),
        ("count", "<u4"),
        ("motors", "<f4", CHANNELS),  # [us]
        ("pad2", "V4"),
    ]
)
AIR = 101325.0  # [Pa]
PATIENCE = 20.0  # for an answer; a firmware that hangs is found, a busy machine is not disturbed [s]
TURN = np.array([1.0, -1.0, -1.0])  # our body's axes (forward, left, up) to the packet's
GONE = "a process of the firmware betaflight has ended in flight: it was killed, or it crashed"
LEVEL = np.array([[1.0, 0.0, 0.0, 0.0]])
STILL = np.zeros((1, 3))


def requests(
    time: Any, dt: float, sticks: Any, rates_b: Any = STILL, attitude: Any = LEVEL, lift: Any = 9.81
) -> np.ndarray:
    """What K flights are told [K]: what is measured now, and to run for `dt` [s].

    Args:
        time: of each flight [s] [K].
        dt: [s].
        sticks: [us] [K, C], C channels of 16; None: no news of them.
        rates_b: [rad/s] [K, 3].
        attitude: (w, x, y, z), body to world [K, 4].
        lift: specific force along the thrust [m/s^2] [K].
    """
    time = np.atleast_1d(time)
    told = np.zeros(len(time), REQUEST)
    told["run_ns"], told["has_state"], told["pressure"] = round(dt * 1e9), 1, AIR
    told["time"] = told["rc_time"] = time
    told["rates"], told["attitude"], told["force"][:, 2] = TURN * rates_b, attitude, -np.asarray(lift)
    if sticks is not None:
        told["has_rc"], told["rc"] = 1, 1500
        told["rc"][:, : np.shape(sticks)[1]] = sticks
    return told


class Process:
    """A firmware process, or one that was forked from it."""

    def __init__(self, link: socket.socket, child: subprocess.Popen | None = None) -> None:
        """Take over the host's end of a link."""
        self.link, self._child, self.time = link, child, 0.0
        link.settimeout(PATIENCE)
        self.reply = talk([self], None)

    @classmethod
    def start(cls, folder: Path, uart: bool = False) -> "Process":
        """Start the firmware in `folder`, which has or gets its settings (eeprom.bin).

        Raises:
            CruiseError: it is not there, or does not start.
        """
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            environment = os.environ | {"LD_PRELOAD": str(find_shim()), "CRUISE_FD": str(theirs.fileno())}
            child = subprocess.Popen(
                [str(find_firmware())],
                cwd=folder,
                env=environment | ({"CRUISE_UART": "1"} if uart else {}),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )
        try:
            return cls(ours, child)
        except BaseException:
            child.kill()
            child.wait()
            raise

    def fork(self) -> "Process":
        """Another firmware that is in all as this one is now."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        message = np.zeros(1, REQUEST)
        message["what"] = FORK
        with theirs:
            guarded(lambda: socket.send_fds(self.link, [message.tobytes()], [theirs.fileno()]))
            self.reply = talk([self], None)
        twin = Process(ours)
        twin.time = self.time
        return twin

    def run(self, dt: float = 1e-3, sticks: Sequence[int] | None = None, rates_b: Any = (0.0, 0.0, 0.0)) -> None:
        """Let it run, level and hovering, for `dt` [s]."""
        rows = None if sticks is None else np.array([sticks])
        self.reply = talk([self], requests(self.time, dt, rows, np.array([rates_b])))
        self.time += dt

    @property
    def motors(self) -> np.ndarray:
        """0 to 1: rear right, front right, rear left, front left [4]."""
        return motors_of(self.reply)[0]

    @property
    def port(self) -> int:
        """Of its first serial port, by TCP on the loopback; 0: it has none."""
        return int(self.reply["port"][0])

    def close(self) -> None:
        """End it: without its host it ends by itself, and what does not is killed."""
        self.link.close()
        if self._child is None:
            return
        try:
            self._child.wait(timeout=3.0)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


def talk(processes: Sequence[Process], told: np.ndarray | None) -> np.ndarray:
    """Tell each of K processes its request, if any, and give their replies [K].

    Raises:
        CruiseError: one has ended, or does not answer.
    """

    def both() -> list[bytes]:
        if told is not None:
            data = told.tobytes()
            for start, process in zip(range(0, len(data), REQUEST.itemsize), processes, strict=True):
                process.link.send(data[start : start + REQUEST.itemsize])
        return [process.link.recv(REPLY.itemsize) for process in processes]

    answers = guarded(both)
    if any(len(answer) != REPLY.itemsize for answer in answers):
        raise CruiseError(GONE)
    return np.frombuffer(b"".join(answers), REPLY)


def motors_of(replies: np.ndarray) -> np.ndarray:
    """The motors' commands, 0 to 1 [K, 4]."""
    return (replies["motors"][:, :4] - 1000) / 1000


def guarded(action: Callable[[], Any]) -> Any:
    """Raises CruiseError where the other side is gone, or does not answer."""
    try:
        return action()
    except TimeoutError:
        raise CruiseError(f"the firmware betaflight has not answered for {PATIENCE:.0f} s") from None
    except OSError:
        raise CruiseError(GONE) from None
