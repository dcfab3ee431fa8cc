"""Loads what a user named in Python: `file.py:Name` or `package.module:Name`. Its code is run, as was asked for.

Modules that lie beside a file are its own: two files that both `import helper` each get the helper of their folder.
"""

import difflib
import hashlib
import importlib
import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from cruise.errors import CruiseError
from cruise.pilots.foreign import explain
from cruise.pilots.siblings import forget, isolate


def names_python(choice: str) -> bool:
    """Whether a choice is written as Python is: `file.py:Name`, `file.py`, or `package.module:Name`."""
    place, colon, name = choice.rpartition(":")
    if not colon:
        return choice.endswith(".py")
    return place.endswith(".py") or (name.isidentifier() and all(part.isidentifier() for part in place.split(".")))


def load_object(choice: str, what: str = "pilot") -> Any:
    """Run the file or import the module, and give what is named in it.

    Args:
        choice: `file.py:Name` or `package.module:Name`.
        what: the object is, for messages.

    Raises:
        CruiseError: there is no such file, module or name, or running it failed.
    """
    place, colon, name = choice.rpartition(":")
    if not colon or not name:
        path = (place or choice).rstrip(":")
        need, usual = ("what flies", "Pilot") if what == "pilot" else ("what is meant", "Name")
        raise CruiseError(f"{what} {choice!r} does not say {need}: give a name in that file, as in {path}:{usual}")
    module = load_module(place, what)
    if not hasattr(module, name):
        raise CruiseError(f"{what} {choice!r}: {_unknown(module, name)}")
    return getattr(module, name)


def load_module(place: str, what: str = "pilot") -> ModuleType:
    """Run `file.py`, or import `package.module`. Raises CruiseError as `load_object` does."""
    return _run_file(place, what) if place.endswith(".py") else _import(place, what)


def _unknown(module: ModuleType, name: str) -> str:
    own = [n for n, thing in vars(module).items() if not n.startswith("_") and _belongs(thing, module)]
    close = difflib.get_close_matches(name, own, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"nothing is called {name!r} there: {hint}it defines {', '.join(own) or 'no class and no function'}"


def _belongs(thing: object, module: ModuleType) -> bool:
    return callable(thing) and getattr(thing, "__module__", None) == module.__name__


def _run_file(place: str, what: str) -> ModuleType:
    try:
        path = Path(place).resolve()
        there = path.is_file()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a name too long, a NUL
        raise CruiseError(f"{what} file {place!r} cannot be read: {explain(error)}") from None
    if not there:
        hint = f"; `cruise new-pilot {place}` writes one to start from" if what == "pilot" else ""
        raise CruiseError(f"{what} file {place} does not exist{hint}")
    room = f"cruise_file_{hashlib.sha256(os.fsencode(path)).hexdigest()[:16]}"
    try:
        return isolate(path, room)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        forget(room)
        raise CruiseError(f"{what} file {place} cannot be run: {explain(error).replace(f'{room}.', '')}") from error


def _import(place: str, what: str) -> ModuleType:
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        return importlib.import_module(place)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise CruiseError(f"{what} module {place} cannot be imported: {explain(error)}") from error
