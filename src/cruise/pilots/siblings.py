"""Python files that find what lies beside them, and nobody else's.

A file and the modules of its folder live in a package of their own, the room: `helper` beside it is `ROOM.helper` in
`sys.modules`. Code in a room has an `__import__` of its own, so that `import helper` means that one there: at the top
of a file, within a function, or by `importlib.import_module`.
"""

import builtins
import functools
import importlib
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

SHARED = frozenset({*sys.stdlib_module_names, "cruise"})  # never taken from beside a file

_built_ins: dict[str, dict[str, Any]] = {}  # of the code in every room


def isolate(path: Path, room: str) -> ModuleType:
    """Run a file, anew at every call, in the package `room`. Modules beside it are run once, when first imported.

    Raises:
        BaseException: whatever its code raises.
    """
    if room not in _built_ins:
        _furnish(room, path.parent)
    known_as = f"{room}.{path.stem.replace('.', '_')}"
    loader = _Loader(known_as, str(path))
    spec = importlib.util.spec_from_file_location(known_as, path, loader=loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[known_as] = module  # where dataclasses, pickles and what is beside it look for it
    loader.exec_module(module)
    return module


def forget(room: str) -> None:
    """Drop the modules of a room, so that they are run anew."""
    for name in [name for name in sys.modules if name.startswith(f"{room}.")]:
        del sys.modules[name]


def _furnish(room: str, folder: Path) -> None:
    """An empty package whose submodules are the modules of a folder."""
    package = ModuleType(room)
    package.__path__ = [str(folder)]
    sys.modules[room] = package
    _built_ins[room] = {**vars(builtins), "__import__": functools.partial(_import, room)}
    if _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)


class _Loader(SourceFileLoader):
    """Runs a file with the built-ins of its room."""

    def exec_module(self, module: ModuleType) -> None:
        """Functions of a module take their built-ins from what its `__builtins__` was when they were defined."""
        module.__dict__["__builtins__"] = _built_ins[_top(module.__name__)]
        super().exec_module(module)


class _Finder(MetaPathFinder):
    """Finds the submodules of rooms."""

    def find_spec(self, fullname: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:
        """None for all that is in no room."""
        if _top(fullname) not in _built_ins:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


_FINDER = _Finder()


def _import(
    room: str,
    name: str,
    globals: Mapping[str, Any] | None = None,
    locals: Mapping[str, Any] | None = None,
    fromlist: Sequence[str] | None = (),
    level: int = 0,
) -> Any:
    """`__import__` for the code in a room: what is beside it comes before what is installed."""
    top = _top(name)
    if level == 0 and _is_beside(room, top):
        module = builtins.__import__(f"{room}.{name}", globals, locals, fromlist or ("__name__",), 0)
        return module if fromlist else sys.modules[f"{room}.{top}"]
    module = builtins.__import__(name, globals, locals, fromlist or (), level)
    return _Importlib(room) if module is importlib else module


def _is_beside(room: str, name: str) -> bool:
    """Whether a module lies in the room's folder. A bare folder is a package only where no other is installed."""
    if name in SHARED:
        return False
    if f"{room}.{name}" in sys.modules:
        return True
    spec = PathFinder.find_spec(name, sys.modules[room].__path__)
    if spec is None:
        return False
    return spec.origin is not None or (name not in sys.modules and importlib.util.find_spec(name) is None)


def _top(name: str) -> str:
    return name.partition(".")[0]


class _Importlib(ModuleType):
    """The module `importlib`, but `import_module` finds what is beside the file."""

    def __init__(self, room: str) -> None:
        super().__init__("importlib")
        self._room = room

    def __getattr__(self, name: str) -> Any:
        return getattr(importlib, name)

    def import_module(self, name: str, package: str | None = None) -> ModuleType:
        """As `importlib.import_module`."""
        beside = not name.startswith(".") and _is_beside(self._room, _top(name))
        return importlib.import_module(f"{self._room}.{name}" if beside else name, package)
