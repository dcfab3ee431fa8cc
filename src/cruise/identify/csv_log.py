"""Flight logs as CSV: one row a sample, columns by name, units in the names."""

from pathlib import Path

import numpy as np

from cruise.errors import CruiseError
from cruise.identify.log import FlightLog
from cruise.toml_file import shown

XYZ = "xyz"
REQUIRED = {
    "time": ("time_s",),
    "throttle": ("throttle",),
    "rate_command": tuple(f"rate_command_{axis}_rad_s" for axis in XYZ),
    "rates": tuple(f"rate_{axis}_rad_s" for axis in XYZ),
}
OPTIONAL = {
    "attitude": tuple(f"q_{part}" for part in "wxyz"),
    "velocity": tuple(f"velocity_{axis}_m_s" for axis in XYZ),
    "acceleration": tuple(f"acceleration_{axis}_m_s2" for axis in XYZ),
    "motors": tuple(f"motor_{number}" for number in (1, 2, 3, 4)),
}


def read_csv(path: Path) -> FlightLog:
    """A log whose first line names the columns; an empty cell is a sample that is not there.

    Raises:
        CruiseError: a column is missing, named twice, or holds what is no number.
    """
    names, rows = _header(path)
    signals = {}
    for signal, columns in (REQUIRED | OPTIONAL).items():
        there = [column for column in columns if column in names]
        if signal in OPTIONAL and not there:
            continue
        for column in columns:
            if column not in names:
                wanted = f"{signal.replace('_', ' ')} is told by {', '.join(columns)}"
                raise CruiseError(f"{shown(path)}: no column {column!r}: {wanted}; there are {', '.join(names)[:200]}")
        found = np.array([[_number(row[names.index(c)], path, k, c) for k, row in rows] for c in columns])
        signals[signal] = found if len(columns) > 1 else found[0]
    return FlightLog(shown(path), **signals)


def _header(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Names of the columns, and the rows with their line numbers."""
    text = path.read_text(encoding="utf-8-sig")
    first, *lines = text.splitlines() or [""]
    names = [name.strip() for name in first.split(",")]
    for name in names:
        if names.count(name) > 1:
            raise CruiseError(f"{shown(path)}: column {name!r} is there {names.count(name)} times")
    rows = [(number, line.split(",")) for number, line in enumerate(lines, start=2) if line.strip()]
    for number, row in rows:
        if len(row) != len(names):
            raise CruiseError(f"{shown(path)}: line {number} has {len(row)} cells, the first line {len(names)}")
    return names, rows


def _number(cell: str, path: Path, line: int, column: str) -> float:
    try:
        return float(cell) if cell.strip() else np.nan
    except ValueError:
        raise CruiseError(f"{shown(path)}: line {line}, {column}: {cell.strip()[:40]!r} is no number") from None
