"""From what a user names to the pilot that flies."""

import os
from collections.abc import Callable
from typing import Any

from cruise.pilots.base import Pilot
from cruise.pilots.foreign import DEFAULT_BUDGET, wrap
from cruise.pilots.scripted import SCRIPTED
from cruise.pilots.source import find_object, names_python
from cruise.storage.onnx_file import load_onnx_pilot, read_onnx_meta
from cruise.storage.policy_file import PolicyMeta, load_policy, read_meta

PilotChoice = str | os.PathLike[str] | Pilot | Callable[..., Any]

ONNX = ".onnx"


def find_pilot(choice: PilotChoice, budget: float = DEFAULT_BUDGET) -> Pilot:
    """The pilot that is meant.

    Args:
        choice: a name (`chaser`, `hover`); a policy, as `load_policy` takes it; an exported `.onnx` file;
            `file.py:Name` or `package.module:Name`, whose code is run; or a Python function, class, object or `Pilot`.
        budget: time for each action of a pilot in plain Python [s].

    Raises:
        CruiseError: there is no such pilot, or it cannot be loaded.
    """
    if not isinstance(choice, str | os.PathLike):
        return wrap(choice, budget=budget)
    name = os.fspath(choice)
    if name in SCRIPTED:
        return SCRIPTED[name]
    if name.endswith(ONNX):
        return load_onnx_pilot(name, budget)
    if names_python(name):
        return wrap(find_object(name), name, budget)
    return load_policy(choice)


def pilot_meta(choice: PilotChoice) -> PolicyMeta | None:
    """What is known of a trained pilot: its track, its number of drones and more. None for all others."""
    if not isinstance(choice, str | os.PathLike):
        return None
    name = os.fspath(choice)
    if name in SCRIPTED or names_python(name):
        return None
    return read_onnx_meta(name) if name.endswith(ONNX) else read_meta(choice)


def identity(choice: PilotChoice) -> Any:
    """The same name or path is the same pilot, so that it flies its drones in one batch."""
    return os.fspath(choice) if isinstance(choice, str | os.PathLike) else id(choice)
