"""From what a user names to the pilot that flies."""

import difflib
import os
from collections.abc import Callable
from typing import Any, TypeVar

from cruise.errors import CruiseError
from cruise.pilots.base import Pilot
from cruise.pilots.foreign import DEFAULT_BUDGET, wrap
from cruise.pilots.loader import load_object, names_python
from cruise.pilots.named import NAMED
from cruise.storage.onnx_file import read_onnx_meta
from cruise.storage.onnx_pilot import load_onnx_pilot
from cruise.storage.policy_file import PolicyMeta, load_policy, read_meta

PilotChoice = str | os.PathLike[str] | Pilot | Callable[..., Any]

ONNX = ".onnx"
T = TypeVar("T")


def find_pilot(choice: PilotChoice, budget: float = DEFAULT_BUDGET) -> Pilot:
    """The pilot that is meant.

    Args:
        choice: a name (`chaser`, `hover`, `se-ibr`, `se-ibr-tuned`); a policy, as `load_policy` takes it; an exported
            `.onnx` file; `file.py:Name` or `package.module:Name`, whose code is run; or a Python function, class,
            object or `Pilot`.
        budget: time for each action of a pilot in plain Python [s].

    Raises:
        CruiseError: there is no such pilot, or it cannot be loaded.
    """
    if not isinstance(choice, str | os.PathLike):
        return wrap(choice, budget=budget)
    name = os.fspath(choice)
    if name in NAMED:
        return NAMED[name]
    if name.endswith(ONNX):
        return load_onnx_pilot(name, budget)
    if names_python(name):
        return wrap(load_object(name), name, budget)
    return _policy(load_policy, name)


def pilot_meta(choice: PilotChoice) -> PolicyMeta | None:
    """What is known of a trained pilot: its track, its number of drones and more. None for all others."""
    if not isinstance(choice, str | os.PathLike):
        return None
    name = os.fspath(choice)
    if name in NAMED or names_python(name):
        return None
    return read_onnx_meta(name) if name.endswith(ONNX) else _policy(read_meta, name)


def _policy(read: Callable[[str], T], name: str) -> T:
    """What is read of a policy; where there is none, the name of another pilot may have been meant."""
    try:
        return read(name)
    except CruiseError as error:
        close = difflib.get_close_matches(name, NAMED, n=1)
        hint = f"; did you mean the pilot {close[0]!r}?" if close else ""
        raise CruiseError(f"{error}{hint}") from None


def identity(choice: PilotChoice) -> Any:
    """The same name or path is the same pilot, so that it flies its drones in one batch."""
    return os.fspath(choice) if isinstance(choice, str | os.PathLike) else id(choice)
