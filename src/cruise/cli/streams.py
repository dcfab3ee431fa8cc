"""What a command prints, and what becomes of it where that fails."""

import contextlib
import os
import sys
from typing import TextIO


def ready_streams() -> str | None:
    """Make the three streams ready, and say what is wrong with the output, if anything is.

    Letters that the output's encoding lacks are written as escapes. A closed stream is replaced by one that leads
    nowhere, or the next file that is opened would take its place and get what is printed.
    """
    closed = sys.stdout is None
    with contextlib.suppress(OSError):
        while (lead := os.open(os.devnull, os.O_RDWR)) <= 2:  # the lowest numbers are taken first
            continue
        os.close(lead)
    if sys.stderr is None:
        sys.stderr = _nowhere()
    if closed:
        sys.stdout = _nowhere()
        return "standard output is closed"
    if getattr(sys.stdout, "errors", "") == "strict" and hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")
    return None


def _nowhere() -> TextIO:
    return open(os.devnull, "w", encoding="utf-8")


def drop_output() -> None:
    """Let what is still to be printed go nowhere, so that Python does not try once more when it ends."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
