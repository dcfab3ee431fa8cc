"""Flight logs of Betaflight's Blackbox, read by orangebox: setpoints, gyroscope, motors and, if there, accelerometer.

Betaflight's axes are roll to the right, pitch with the nose down and yaw; setpoint and gyroscope agree in their signs,
and that is all that identification needs of them.
"""

from pathlib import Path
from typing import Any

import numpy as np

from cruise.errors import CruiseError, one_line
from cruise.extras import import_extra
from cruise.identify.log import FlightLog
from cruise.toml_file import shown

MOTORS = (3, 1, 0, 2)  # Betaflight counts rear right, front right, rear left, front left; ours front left, clockwise
GRAVITY = 9.80665
NEEDED = ("time", *(f"setpoint[{k}]" for k in range(4)), *(f"gyroADC[{k}]" for k in range(3)))


def read_blackbox(path: Path) -> FlightLog:
    """The first log of a file.

    Raises:
        CruiseError: not a Blackbox log, or it lacks setpoints or gyroscope.
    """
    orangebox = import_extra("orangebox", "identify", "Blackbox logs need orangebox")
    try:
        parser = orangebox.Parser.load(str(path), allow_invalid_header=True)
        names, headers = list(parser.field_names), dict(parser.headers)
        rows = np.array([frame.data[: len(names)] for frame in parser.frames()], dtype=float).reshape(-1, len(names))
    except Exception as error:  # orangebox raises whatever a damaged file leads it to
        raise CruiseError(f"{shown(path)}: not a Blackbox log: {one_line(error) or type(error).__name__}") from error
    columns = dict(zip(names, rows.T, strict=True))
    for name in NEEDED:
        if name not in columns:
            raise CruiseError(f"{shown(path)}: the log holds no {name}: Betaflight 4.0 or later writes it")
    return _flight(shown(path), columns, headers)


def _flight(name: str, columns: dict[str, Any], headers: dict[str, Any]) -> FlightLog:
    def several(stem: str, count: int, scale: float) -> Any:
        names = [f"{stem}[{k}]" for k in range(count)]
        return scale * np.array([columns[one] for one in names]) if set(names) <= set(columns) else None

    motors = several("motor", 4, 1.0)
    if motors is not None:
        low, high = _motor_range(headers)
        motors = np.clip((motors[list(MOTORS)] - low) / (high - low), 0.0, 1.0)
    keep = np.concatenate([[True], np.diff(columns["time"]) > 0])
    log: dict[str, Any] = {
        "time": (columns["time"] - columns["time"][0]) / 1e6,
        "throttle": np.clip(columns["setpoint[3]"] / 1000, 0.0, 1.0),
        "rate_command": several("setpoint", 3, np.pi / 180),
        "rates": several("gyroADC", 3, np.pi / 180),
        "acceleration": several("accSmooth", 3, GRAVITY / float(headers.get("acc_1G", 2048))),
        "motors": motors,
    }
    kept: dict[str, Any] = {key: None if value is None else value[..., keep] for key, value in log.items()}
    return FlightLog(name, **kept)


def _motor_range(headers: dict[str, Any]) -> tuple[float, float]:
    """Lowest and highest motor output, as the header says."""
    output = headers.get("motorOutput", (48, 2047))
    low, high = (float(one) for one in (output.split(",") if isinstance(output, str) else output))
    return (low, high) if high > low else (48.0, 2047.0)
