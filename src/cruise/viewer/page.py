"""The replay page: one HTML file that needs no network."""

import functools
import html
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from cruise.errors import CruiseError
from cruise.storage.atomic import write_atomically
from cruise.storage.race_log import RaceLog
from cruise.viewer.packing import pack_race

FORMAT_VERSION = 1  # of the data, which the page's own code checks
SAME_PLACE = 1e-3  # [m]
TITLE, DATA = "{{title}}", "{{data}}"  # holes of the built page


def replay_page(logs: Sequence[RaceLog], labels: Sequence[str], ghost: RaceLog | None = None) -> bytes:
    """A page that replays races, as the bytes of an HTML file.

    Args:
        logs: races to step through, at least one.
        labels: what tells each from the others.
        ghost: a race whose drones fly along in all of them.

    Raises:
        CruiseError: the ghost flew another track.
    """
    for log in logs:
        if ghost is not None and not _same_gates(log, ghost):
            raise CruiseError(f"the ghost flew track {ghost.track!r}, whose gates are not those of {log.track!r}")
    races = [pack_race(log, label, ghost) for log, label in zip(logs, labels, strict=True)]
    return render(page_title(logs[0]), {"races": races})


def write_replay(path: Path | str, logs: Sequence[RaceLog], labels: Sequence[str]) -> None:
    """Write `replay_page(logs, labels)` to a file, whole or not at all."""
    write_atomically(path, replay_page(logs, labels))


def page_title(log: RaceLog) -> str:
    """What the browser calls the page."""
    drones = "1 drone" if log.num_drones == 1 else f"{log.num_drones} drones"
    return f"{log.track}, {drones}"


def render(title: str, data: dict[str, Any]) -> bytes:
    """The built page with a title and data put in."""
    text = json.dumps({"format": FORMAT_VERSION} | data, separators=(",", ":"), allow_nan=False)
    # In a script element only "</script" and "<!--" would end or bend the text; without "<" there is neither.
    head, middle, tail = _template()
    return "".join([head, html.escape(title), middle, text.replace("<", "\\u003c"), tail]).encode()


@functools.cache
def _template() -> tuple[str, str, str]:
    """The built page: what comes before the title, between title and data, and after the data."""
    page = (resources.files("cruise.viewer") / "page.html").read_text(encoding="utf-8")
    head, rest = page.split(TITLE, 1)
    middle, tail = rest.rsplit(DATA, 1)
    return head, middle, tail


def _same_gates(log: RaceLog, other: RaceLog) -> bool:
    """Whether gates stand, lean and move alike."""
    names = ("gate_position", "gate_roll", "gate_pitch", "gate_motion")
    pairs = [(getattr(log, name), getattr(other, name)) for name in names]
    return all(a.shape == b.shape and np.allclose(a, b, atol=SAME_PLACE) for a, b in pairs)
