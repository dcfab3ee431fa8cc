"""Finds what a user named in Python: `file.py:Name` or `package.module:Name`. Its code is run, as was asked for."""

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


def names_python(choice: str) -> bool:
    """Whether a choice of pilot is written as Python is: `file.py:Name`, `file.py`, or `package.module:Name`."""
    place, colon, name = choice.rpartition(":")
    if not colon:
        return choice.endswith(".py")
    return place.endswith(".py") or (name.isidentifier() and all(part.isidentifier() for part in place.split(".")))


def find_object(choice: str) -> Any:
    """Run the file or import the module, and give what is named in it.

    Raises:
        CruiseError: there is no such file, module or name, or running it failed.
    """
    place, colon, name = choice.rpartition(":")
    if not colon or not name:
        path = (place or choice).rstrip(":")
        raise CruiseError(f"pilot {choice!r} does not say what flies: give a name in that file, as in {path}:Pilot")
    module = _run_file(place) if place.endswith(".py") else _import(place)
    if not hasattr(module, name):
        raise CruiseError(f"pilot {choice!r}: {_unknown(module, name)}")
    return getattr(module, name)


def _unknown(module: ModuleType, name: str) -> str:
    own = [n for n, thing in vars(module).items() if not n.startswith("_") and _belongs(thing, module)]
    close = difflib.get_close_matches(name, own, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"nothing is called {name!r} there: {hint}it defines {', '.join(own) or 'no class and no function'}"


def _belongs(thing: object, module: ModuleType) -> bool:
    return callable(thing) and getattr(thing, "__module__", None) == module.__name__


def _run_file(place: str) -> ModuleType:
    path = Path(place).resolve()
    if not path.is_file():
        raise CruiseError(f"pilot file {place} does not exist; `cruise new-pilot {place}` writes one to start from")
    known_as = f"cruise_pilot_{path.stem}_{hashlib.sha256(os.fsencode(path)).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(known_as, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[known_as] = module  # where dataclasses and pickles look for it
    _look_in(str(path.parent))
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[known_as]
        raise CruiseError(f"pilot file {place} cannot be run: {explain(error)}") from error
    return module


def _import(place: str) -> ModuleType:
    _look_in(os.getcwd())
    try:
        return importlib.import_module(place)
    except (Exception, SystemExit) as error:
        raise CruiseError(f"pilot module {place} cannot be imported: {explain(error)}") from error


def _look_in(folder: str) -> None:
    """Let Python find modules in a folder, after all others."""
    if folder not in sys.path:
        sys.path.append(folder)
