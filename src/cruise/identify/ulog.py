"""Flight logs of PX4, read by pyulog. Its frames are north-east-down and forward-right-down."""

from pathlib import Path
from typing import Any

import numpy as np

from cruise.errors import CruiseError, one_line
from cruise.extras import import_extra
from cruise.identify.log import FlightLog
from cruise.toml_file import shown

FLIP = np.array([[1.0], [-1.0], [-1.0]])  # down to up, right to left
MOTORS = (2, 0, 3, 1)  # PX4's quad x counts front right, rear left, front left, rear right; ours front left, clockwise
Series = tuple[Any, Any]  # times [K] s, values [n K]


def read_ulog(path: Path) -> FlightLog:
    """The log of one flight, on the clock of the gyroscope.

    Raises:
        CruiseError: not a ULog, or topics are missing.
    """
    pyulog = import_extra("pyulog", "identify", "PX4's logs need pyulog")
    try:
        with path.open("rb") as file:  # not by its name: pyulog leaves what it cannot read open
            topics = {topic.name: topic for topic in reversed(pyulog.ULog(file).data_list)}
    except Exception as error:  # pyulog raises whatever a damaged file leads it to
        raise CruiseError(f"{shown(path)}: not a log of PX4: {one_line(error)}") from error
    rates = _first(topics, ("vehicle_angular_velocity", "xyz[3]"), ("sensor_combined", "gyro_rad[3]"))
    command = _first(topics, ("vehicle_rates_setpoint", "roll,pitch,yaw"))
    throttle = _throttle(topics)
    if rates is None or command is None or throttle is None:
        what = "body rates" if rates is None else "rate setpoints" if command is None else "thrust setpoints"
        raise CruiseError(f"{shown(path)}: holds no {what}; there are {', '.join(sorted(topics))[:200]}")
    time = rates[0]
    attitude = _sampled(_first(topics, ("vehicle_attitude", "q[4]")), time)
    velocity = _sampled(_first(topics, ("vehicle_local_position", "vx,vy,vz")), time)
    motors = _held(_first(topics, ("actuator_motors", "control[4]")), time)
    return FlightLog(
        shown(path),
        time=time - time[0],
        throttle=_held(throttle, time)[0],
        rate_command=FLIP * _held(command, time),
        rates=FLIP * rates[1],
        attitude=None
        if attitude is None
        else np.vstack([attitude[:2], -attitude[2:]]) / np.linalg.norm(attitude, axis=0),
        velocity=None if velocity is None else FLIP * velocity,
        acceleration=_acceleration(topics, time),
        motors=None if motors is None else np.clip(motors[list(MOTORS)], 0, 1),
    )


def _first(topics: dict[str, Any], *choices: tuple[str, str]) -> Series | None:
    """The first of these topics that is there, with all of its fields: `a,b,c`, or `q[4]` for q[0] to q[3]."""
    for name, fields in choices:
        data = topics[name].data if name in topics else {}
        stem, _, count = fields.rstrip("]").partition("[")
        names = fields.split(",") if "[" not in fields else [f"{stem}[{k}]" for k in range(int(count or 3))]
        if data and all(field in data for field in names) and len(data["timestamp"]) > 1:
            return np.asarray(data["timestamp"], float) / 1e6, np.array(
                [np.asarray(data[field], float) for field in names]
            )
    return None


def _throttle(topics: dict[str, Any]) -> Series | None:
    """Collective thrust that is asked for, 0 to 1; PX4's points down, and older logs hold it without a sign."""
    found = _first(
        topics,
        ("vehicle_thrust_setpoint", "xyz[3]"),
        ("vehicle_rates_setpoint", "thrust_body[3]"),
        ("vehicle_rates_setpoint", "thrust,thrust"),
    )
    return None if found is None else (found[0], np.clip(np.abs(found[1][-1:]), 0.0, 1.0))


def _acceleration(topics: dict[str, Any], time: Any) -> Any:
    found = _sampled(
        _first(topics, ("sensor_combined", "accelerometer_m_s2[3]"), ("vehicle_acceleration", "xyz[3]")), time
    )
    return None if found is None else FLIP * found


def _held(series: Series | None, time: Any) -> Any:
    """The last value before each time."""
    if series is None:
        return None
    return series[1][:, np.maximum(np.searchsorted(series[0], time, side="right") - 1, 0)]


def _sampled(series: Series | None, time: Any) -> Any:
    """Samples where they are, NaN between them: each on the row of the clock that is nearest."""
    if series is None:
        return None
    found = np.full((len(series[1]), time.size), np.nan)
    rows = np.clip(np.searchsorted(time, series[0]), 0, time.size - 1)
    found[:, rows] = series[1]
    return found
