"""Tells Gymnasium of the environment, without waiting for Gymnasium where nobody uses it."""

import importlib.util
import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

LIBRARY = "gymnasium"
NAME = "cruise/Race-v0"
ENTRY = "cruise.adapters.gymnasium_env:RaceEnv"
VECTOR_ENTRY = "cruise.adapters.gymnasium_vector:VectorRaceEnv"


def register_when_imported() -> None:
    """Register the environment now if Gymnasium is there, or else as soon as somebody imports it."""
    if LIBRARY in sys.modules:
        register()
    elif not any(isinstance(finder, _Watch) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Watch())


def register() -> None:
    """Register the environment."""
    import gymnasium  # noqa: PLC0415  (slow to import)

    if NAME not in gymnasium.registry:
        gymnasium.register(NAME, entry_point=ENTRY, vector_entry_point=VECTOR_ENTRY)


class _Watch(MetaPathFinder):
    """Sees Gymnasium being imported, once."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Where the others find it, with the registration to follow."""
        if fullname != LIBRARY:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                register()

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec
