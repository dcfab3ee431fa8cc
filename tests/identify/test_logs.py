"""Flight logs: every format gives the same flight, and whatever is wrong with one is told in one line."""

import gc
import io

import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.identify import load_log
from tests.identify.logs import COLUMNS, EVERYTHING, csv_text, table, write_blackbox, write_ulog

ROWS = table()


def changed(column: int, value: object, rows: slice = slice(None)) -> str:
    """A CSV log with other numbers in a column."""
    other = ROWS.copy()
    other[rows, column] = value
    return csv_text(other)


def with_cell(text: str) -> str:
    """A CSV log with this in the third cell of its fifth line."""
    lines = csv_text().splitlines()
    cells = lines[4].split(",")
    cells[2] = text
    return "\n".join([*lines[:4], ",".join(cells), *lines[5:]])


def also(columns: list[str], values: np.ndarray) -> str:
    """A CSV log with more columns."""
    return csv_text(
        np.concatenate([ROWS, np.broadcast_to(values, (len(ROWS), len(columns)))], axis=1), COLUMNS + columns
    )


Q, V = ["q_w", "q_x", "q_y", "q_z"], ["velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s"]
BAD_CSV = {
    "empty": ("", "is empty"),
    "blank": ("\n\n", "no column 'time_s': time is told by time_s"),
    "no header": ("1,2,3\n4,5,6\n", "no column 'time_s'"),
    "head alone": (",".join(COLUMNS), "has 0 rows: a flight has more"),
    "one row": ("\n".join(csv_text().splitlines()[:2]), "has 1 rows"),
    "no throttle": (
        csv_text().replace("throttle", "thrust"),
        "no column 'throttle': throttle is told by",
    ),
    "no unit": (
        csv_text().replace("rate_x_rad_s", "rate_x"),
        "no column 'rate_x_rad_s': rates is told by",
    ),
    "twice": (csv_text().replace("rate_y_rad_s", "rate_x_rad_s"), "column 'rate_x_rad_s' is there 2 times"),
    "half a quaternion": (also(Q[:2], np.ones(2)), "no column 'q_y': attitude is told by q_w, q_x, q_y, q_z"),
    "long line": (csv_text() + "1,2,3,4,5,6,7,8,9\n", "line 302 has 9 cells, the first line 8"),
    "short line": (csv_text() + "1,2\n", "line 302 has 2 cells"),
    "semicolons": (csv_text().replace(",", ";"), "no column 'time_s'"),
    "text": (with_cell("fast"), "line 5, rate_command_x_rad_s: 'fast' is no number"),
    "comma for a point": (with_cell("1.2.3"), "line 5, rate_command_x_rad_s: '1.2.3' is no number"),
    "time without a number": (changed(0, np.nan, slice(7, 8)), "time of row 8 is no number"),
    "infinite time": (changed(0, np.inf, slice(299, 300)), "time of row 300 is no number"),
    "time stands still": (changed(0, ROWS[8, 0], slice(9, 10)), "time does not rise at row 10: 0.08 s, then 0.08 s"),
    "time runs back": (changed(0, 0.0, slice(20, 21)), "time does not rise at row 21: 0.19 s, then 0 s"),
    "short": (csv_text(table(1.0)), "lasts 0.99 s: at least 2 s are needed"),
    "slow": (csv_text(table(20.0, 0.1)), "has 10 rows a second: at least 40 are needed, 250 are good"),
    "no rates": (changed(5, np.nan), "rates: 0 rows hold numbers, at least 20 are needed"),
    "few rates": (changed(5, np.nan, slice(15, None)), "rates: 15 rows hold numbers"),
    "no throttle at all": (changed(1, np.nan), "throttle: 0 rows hold numbers"),
    "degrees": (changed(5, 700.0), "rates reach 700 rad/s: are they in degrees?"),
    "degrees asked for": (changed(2, -500.0), "rate command reach 500 rad/s: are they in degrees?"),
    "per cent": (changed(1, 30.0), "throttle must lie within 0 and 1, not 30 and 30"),
    "reverse": (changed(1, -0.5), "throttle must lie within 0 and 1, not -0.5 and -0.5"),
    "on the ground": (changed(1, 0.0), "throttle never opens: nothing flew"),
    "hands off": (changed(slice(2, 5), 0.0), "rate command never changes"),
    "motors in us": (
        also([f"motor_{k}" for k in (1, 2, 3, 4)], np.full(4, 1500.0)),
        "motors must lie within",
    ),
    "no quaternion": (also(Q, np.full(4, 0.1)), "attitude: quaternions are not of length 1"),
    "millimetres": (also(V, np.full(3, 2500.0)), "velocity reaches 2500 m/s: is it in m/s?"),
    "velocity that is empty": (also(V, np.full(3, np.nan)), "velocity: 0 rows hold numbers"),
    "not text": (b"\xff\xfe\x00time_s", "cannot be read: 'utf-8' codec can't decode"),
}


def refused(path) -> str:
    with pytest.raises(CruiseError) as caught:
        load_log(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert message.isprintable()
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize("case", BAD_CSV)
def test_every_bad_csv_gets_one_line(case, tmp_path):
    content, expected = BAD_CSV[case]
    path = tmp_path / "flight.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert refused(path).startswith(expected)


def ulog(**without: object) -> dict:
    """Topics of the flight of `table`, in PX4's frames."""
    time, down = ROWS[:, :1], [1.0, -1.0, -1.0]
    xyz = ["float[3] xyz"]
    topics = {
        "vehicle_angular_velocity": (xyz, np.hstack([time, ROWS[:, 5:] * down])),
        "vehicle_rates_setpoint": (
            ["float roll", "float pitch", "float yaw", "float[3] thrust_body"],
            np.hstack([time, ROWS[:, 2:5] * down, np.zeros((len(ROWS), 2)), -ROWS[:, 1:2]]),
        ),
        "vehicle_attitude": (["float[4] q"], np.hstack([time, np.tile([0.6, 0.0, 0.8, 0.0], (len(ROWS), 1))])[::2]),
    }
    return {name: topic for name, topic in topics.items() if name not in without}


def blackbox(names: list[str]) -> tuple[list[str], np.ndarray]:
    """The flight of `table` in Betaflight's units."""
    degrees = np.degrees(np.concatenate([ROWS[:, 2:5], ROWS[:, 5:8]], axis=1))
    known = {f"setpoint[{k}]": degrees[:, k] for k in range(3)} | {f"gyroADC[{k}]": degrees[:, 3 + k] for k in range(3)}
    known |= {"setpoint[3]": 1000 * ROWS[:, 1], **{f"motor[{k}]": np.full(len(ROWS), 158 + 400 * k) for k in range(4)}}
    chosen = [name for name in known if name not in names]
    return chosen, np.column_stack([ROWS[:, 0], *(known[name] for name in chosen)])


BAD_OTHERS = {
    "ulog of noise": ("x.ulg", lambda path: path.write_bytes(bytes(range(256))), "not a log of PX4"),
    "ulog cut short": ("x.ulg", lambda path: path.write_bytes(b"ULog\x01\x12\x35"), "not a log of PX4"),
    "ulog without rates": (
        "x.ulg",
        lambda p: write_ulog(p, ulog(vehicle_angular_velocity=0)),
        "holds no body rates; there",
    ),
    "ulog without setpoints": (
        "x.ulg",
        lambda p: write_ulog(p, ulog(vehicle_rates_setpoint=0)),
        "holds no rate setpoints",
    ),
    "ulog of nothing": ("x.ulg", lambda path: write_ulog(path, {}), "holds no body rates"),
    "blackbox of noise": ("x.bbl", lambda path: path.write_bytes(bytes(range(256))), "not a Blackbox log"),
    "blackbox of text": ("x.txt", lambda path: path.write_text("time,gyro\n1,2\n"), "not a Blackbox log"),
    "blackbox without gyroscope": (
        "x.bbl",
        lambda path: write_blackbox(path, *blackbox(["gyroADC[1]"])),
        "the log holds no gyroADC[1]: Betaflight 4.0 or later writes it",
    ),
    "blackbox without setpoints": (
        "x.bfl",
        lambda path: write_blackbox(path, *blackbox(["setpoint[3]"])),
        "the log holds no setpoint[3]",
    ),
    "nobody's ending": (
        "x.bag",
        lambda path: path.write_text("x"),
        "a flight log ends in .csv, .ulg, .bbl",
    ),
    "a folder": ("x.csv", lambda path: path.mkdir(), "is a directory, not a flight log"),
    "not there": ("x.csv", lambda path: None, "no such flight log"),
}


@pytest.mark.parametrize("case", BAD_OTHERS)
def test_every_other_bad_log_gets_one_line(case, tmp_path):
    name, write, expected = BAD_OTHERS[case]
    write(tmp_path / name)
    assert refused(tmp_path / name).startswith(expected)


def test_no_bad_log_stays_open(tmp_path):
    (tmp_path / "x.ulg").write_bytes(b"no ULog")
    with pytest.raises(CruiseError) as told:  # which holds on to whatever was opened
        load_log(tmp_path / "x.ulg")
    files = [thing for thing in gc.get_objects() if isinstance(thing, io.BufferedReader)]
    assert told.value.__cause__ is not None
    assert not [file for file in files if "x.ulg" in str(file.name) and not file.closed]


def test_csv_ulog_and_blackbox_tell_the_same_flight(tmp_path):
    (tmp_path / "a.csv").write_text(csv_text())
    write_ulog(tmp_path / "a.ulg", ulog())
    write_blackbox(tmp_path / "a.bbl", *blackbox([]))
    logs = [load_log(tmp_path / f"a.{ending}") for ending in ("csv", "ulg", "bbl")]
    for log in logs:
        np.testing.assert_allclose(log.time, ROWS[:, 0], atol=2e-6)
        np.testing.assert_allclose(log.throttle, ROWS[:, 1], atol=1e-3)
        np.testing.assert_allclose(log.rate_command, ROWS[:, 2:5].T, atol=0.01)
        np.testing.assert_allclose(log.rates, ROWS[:, 5:].T, atol=0.01)
    np.testing.assert_allclose(logs[1].attitude[:, ::2].T, np.tile([0.6, 0, -0.8, 0], (150, 1)), atol=1e-6)
    assert np.isnan(logs[1].attitude[:, 1::2]).all()
    np.testing.assert_allclose(logs[2].motors[:, 0], np.array([1200, 400, 0, 800]) / 1889)


def test_every_column_is_read(tmp_path):
    rows = np.random.default_rng(0).uniform(0.1, 0.5, (300, len(EVERYTHING)))
    rows[:, 0] = 0.01 * np.arange(300)
    q = [EVERYTHING.index(name) for name in Q]
    rows[:, q] /= np.linalg.norm(rows[:, q], axis=1, keepdims=True)
    (tmp_path / "all.csv").write_text("\ufeff" + csv_text(rows, EVERYTHING))
    log = load_log(tmp_path / "all.csv")
    found = np.vstack(
        [log.time, log.throttle, log.rate_command, log.rates, log.attitude, log.velocity, log.acceleration]
    )
    np.testing.assert_allclose(np.vstack([found, log.motors]), rows.T, rtol=1e-5)
