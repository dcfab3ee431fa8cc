#!/usr/bin/env python3
"""Stands for the firmware where it is not installed: a rate loop of its own behind the same socket."""

import math
import os
import signal
import socket
import struct

REQUEST = struct.Struct("<QBBB5x" + "d3d3d4d6ddd" + "16H")
REPLY = struct.Struct("<QIIIII16f4x")
GAINS = (0.40, 0.46, 3.12)  # of a motor's range per rad/s: those of the vehicle racer
# Signs of roll, pitch and yaw in its motors: rear right, front right, rear left, front left.
MIX = ((-1, 1, 1), (-1, -1, -1), (1, 1, -1), (1, -1, 1))
RUN, FORK = 0, 1


def motors(rates, sticks):
    """Thousandths of the range above 1000, as its mixer would."""
    full = [math.radians(580) / 500] * 3
    wanted = [(sticks[0] - 1500) * full[0], (sticks[1] - 1500) * full[1], (1500 - sticks[3]) * full[2]]
    errors = [gain * (want - rate) for gain, want, rate in zip(GAINS, wanted, rates, strict=True)]
    throttle = (sticks[2] - 1050) / 950 if sticks[4] > 1700 else 0.0
    shares = [throttle + sum(sign * error for sign, error in zip(signs, errors, strict=True)) for signs in MIX]
    return [1000 + 1000 * min(max(share, 0.0), 1.0) if sticks[4] > 1700 else 1000.0 for share in shares]


def main():
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    link = socket.socket(fileno=int(os.environ["CRUISE_FD"]))
    now, sent, out, sticks = 0, 0, [1000.0] * 4, [1500, 1500, 988, 1500, 1000]
    while True:
        try:
            link.send(REPLY.pack(now, sent, os.getpid(), 0, 0, 4, *out, *(0.0,) * 12))
            data, fds, _, _ = socket.recv_fds(link, REQUEST.size, 1)
        except OSError:
            return
        if len(data) != REQUEST.size:
            return
        run, what, _, has_rc, _, p, q, r, *rest = REQUEST.unpack(data)
        if what == FORK:
            if os.fork() == 0:
                link.close()
                link = socket.socket(fileno=fds[0])
            else:
                os.close(fds[0])
            continue
        sticks = rest[-16:] if has_rc else sticks
        now, sent, out = now + run, 1, motors((p, -q, -r), sticks)


if __name__ == "__main__":
    main()
