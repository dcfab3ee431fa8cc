"""Flight logs as their programs write them, small."""

import struct
from pathlib import Path

import numpy as np

from cruise.identify.csv_log import OPTIONAL, REQUIRED

COLUMNS = [column for columns in REQUIRED.values() for column in columns]
EVERYTHING = [column for columns in (REQUIRED | OPTIONAL).values() for column in columns]


def table(seconds: float = 3.0, dt: float = 0.01) -> np.ndarray:
    """Rows of `COLUMNS`: time, throttle, rates asked for, rates."""
    time = np.arange(0, seconds, dt)
    asked = np.sign(np.sin(7 * time + np.arange(3)[:, None]))
    return np.concatenate([[time], [0.3 + 0.1 * np.sin(time)], asked, 0.9 * asked]).T


def csv_text(rows: np.ndarray | None = None, columns: list[str] = COLUMNS) -> str:
    """A CSV log."""
    rows = table() if rows is None else rows
    return "\n".join([",".join(columns), *(",".join(f"{x:.6g}" for x in row) for row in rows)]) + "\n"


def write_ulog(path: Path, topics: dict[str, tuple[list[str], np.ndarray]]) -> None:
    """A ULog with topics of floats, by name: their fields, and rows of a time in s and their values."""
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), _message("B", bytes(40))]
    for name, (fields, _) in topics.items():
        parts.append(_message("F", f"{name}:uint64_t timestamp;{''.join(f'{one};' for one in fields)}".encode()))
    for number, name in enumerate(topics):
        parts.append(_message("A", struct.pack("<BH", 0, number) + name.encode()))
    for number, (_, rows) in enumerate(topics.values()):
        for time, *values in rows:
            body = struct.pack(f"<HQ{len(values)}f", number, int(1e6 * time) + 1, *values)
            parts.append(_message("D", body))
    path.write_bytes(b"".join(parts))


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def write_blackbox(path: Path, names: list[str], rows: np.ndarray) -> None:
    """A Blackbox log of intra frames alone, every field a signed number of variable length."""
    fields = ["loopIteration", "time", *names]
    count = len(fields)
    lines = [
        "Product:Blackbox flight data recorder by Nicholas Sherlock",
        "Data version:2",
        "I interval:1",
        "P interval:1/1",
        f"Field I name:{','.join(fields)}",
        f"Field I signed:{','.join('1' * count)}",
        f"Field I predictor:{','.join('0' * count)}",
        f"Field I encoding:{','.join('0' * count)}",
        f"Field P predictor:{','.join('0' * count)}",
        f"Field P encoding:{','.join('0' * count)}",
        "motorOutput:158,2047",
        "acc_1G:2048",
    ]
    content = "".join(f"H {line}\n" for line in lines).encode()
    for k, (time, *values) in enumerate(rows):
        content += b"I" + b"".join(_signed(round(x)) for x in (k, 1e6 * time, *values))
    path.write_bytes(content + b"E\xffEnd of log\x00")


def _signed(value: int) -> bytes:
    """Zigzag, seven bits a byte, the lowest first."""
    left, out = (value << 1) ^ (value >> 63), bytearray()
    left &= 0xFFFFFFFF
    while left > 127:
        out.append(left & 127 | 128)
        left >>= 7
    return bytes([*out, left])
