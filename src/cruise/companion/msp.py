"""Betaflight over a serial line or UDP: MultiWii Serial Protocol, version 1.

The firmware must have MSP on that port and `set msp_override_channels_mask = 31`: roll, pitch, throttle, yaw and the
switch that arms come from here while the pilot's MSP OVERRIDE switch is on. The companion repeats the state that the
firmware reports, so that it can end a flight and cannot begin one: a switch that was never off arms nothing.
"""

import socket
import struct
import urllib.parse
from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from cruise.companion.link import Heard, LinkLost
from cruise.dynamics.attitude import Setpoint
from cruise.interop.betaflight.sticks import StickMap, YawLoop, not_wound

STATUS, BOX_IDS, SET_RAW_RC, SET_ARMING_DISABLED = 101, 119, 200, 99
ARM_BOX, OVERRIDE_BOX = 0, 50  # permanent numbers
LOW, HIGH = 1000, 2000  # of a switch [us]
NEUTRAL = (1500, 1500, LOW, 1500)
MOST_PENDING = 4096  # bytes that are no message yet


@runtime_checkable
class Port(Protocol):
    """A line that does not wait."""

    def read(self, size: int) -> bytes:
        """What came, at most `size` bytes."""

    def write(self, data: bytes) -> int | None:
        """Send."""

    def close(self) -> None:
        """Let go."""


class UdpPort:
    """A port that is reached by UDP, as through a bridge of its Wi-Fi module: what one datagram holds is not split."""

    def __init__(self, address: str) -> None:
        """To HOST:PORT. Raises OSError or ValueError where there is no such place."""
        place = urllib.parse.urlsplit(f"//{address}")
        if not place.hostname or not place.port:
            raise ValueError("not udp:HOST:PORT")
        family, kind, protocol, _, where = socket.getaddrinfo(place.hostname, place.port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)
        self._socket.connect(where)  # nobody else is heard

    def read(self, size: int) -> bytes:
        """See `Port`."""
        got = b""
        while len(got) < size:
            try:
                got += self._socket.recv(size - len(got))
            except BlockingIOError:
                break
        return got

    def write(self, data: bytes) -> int | None:
        """See `Port`."""
        return self._socket.send(data)

    def close(self) -> None:
        """See `Port`."""
        self._socket.close()


def message(code: int, payload: bytes = b"") -> bytes:
    """A request."""
    body = bytes([len(payload), code]) + payload
    return b"$M<" + body + bytes([checksum(body)])


def checksum(body: bytes) -> int:
    """Exclusive or of all bytes."""
    total = 0
    for byte in body:
        total ^= byte
    return total


class Decoder:
    """Bytes as they come into answers; what is damaged is left out."""

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Code and payload of every whole answer."""
        self._pending = (self._pending + data)[-MOST_PENDING:]
        while (start := self._pending.find(b"$M>")) >= 0:
            rest = self._pending[start:]
            if len(rest) < 5 or len(rest) < rest[3] + 6:
                self._pending = rest
                return
            body = rest[3 : rest[3] + 5]
            whole = checksum(body) == rest[rest[3] + 5]
            self._pending = rest[rest[3] + 6 :] if whole else rest[3:]
            if whole:
                yield rest[4], body[2:]


class MspLink:
    """See `cruise.companion.link.Link`."""

    def __init__(self, port: Port, sticks: StickMap) -> None:
        """Ask nothing yet."""
        self._port, self._sticks, self._decoder = port, sticks, Decoder()
        self._boxes: list[int] = []
        self._heard: Heard | None = None
        self._yaw: YawLoop = not_wound(0.0)
        self._since = 0.0
        self.now = 0.0

    def poll(self, now: float) -> Heard | None:
        """As `Link.poll`."""
        self.now = now
        try:
            data = self._port.read(MOST_PENDING)
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None
        for code, payload in self._decoder.feed(data):
            self._take(code, payload, now)
        self._write(message(STATUS if self._boxes else BOX_IDS))
        return self._heard

    def _take(self, code: int, payload: bytes, now: float) -> None:
        if code == BOX_IDS:
            self._boxes = list(payload)
        elif code == STATUS and self._boxes and len(payload) >= 10:
            flags = struct.unpack_from("<I", payload, 6)[0]
            on = {box for bit, box in enumerate(self._boxes[:32]) if flags >> bit & 1}
            self._heard = Heard(now, ARM_BOX in on, OVERRIDE_BOX in on)

    def command(self, asked: Setpoint, yaw_rate: float, armed: bool) -> None:
        """As `Link.command`."""
        self._yaw = self._sticks.wind(self._yaw, yaw_rate, min(self.now - self._since, 0.1))
        self._since = self.now
        self._yaw = self._sticks.yaw_loop(self._yaw, asked.rates_b[2], yaw_rate, 1)
        roll, pitch, _ = asked.rates_b
        four = self._sticks.channels(Setpoint(asked.thrust, (roll, pitch, self._yaw.asked)))
        self._channels((*(round(float(one)) for one in four), HIGH if armed else LOW))

    def stand_by(self) -> None:
        """As `Link.stand_by`."""
        self._yaw = not_wound(0.0)
        self._channels((*NEUTRAL, LOW))

    def disarm(self) -> None:
        """As `Link.disarm`."""
        self.stand_by()
        self._write(message(SET_ARMING_DISABLED, b"\x01"))

    def close(self) -> None:
        """As `Link.close`."""
        self._port.close()

    def _channels(self, values: tuple[int, ...]) -> None:
        self._write(message(SET_RAW_RC, struct.pack(f"<{len(values)}H", *values)))

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (OSError, ValueError) as error:
            raise LinkLost(str(error)) from None
