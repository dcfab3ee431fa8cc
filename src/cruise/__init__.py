"""CRUISE: learning to race drones against drones."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cruise.api import evaluate, load_policy, load_track, make_env, race
    from cruise.api_training import train
    from cruise.errors import CruiseError

__version__ = "0.1.0"

__all__ = ["CruiseError", "__version__", "evaluate", "load_policy", "load_track", "make_env", "race", "train"]

_HOMES = {
    "CruiseError": "cruise.errors",
    "train": "cruise.api_training",
}  # of public names that are not in `cruise.api`


def __getattr__(name: str) -> Any:
    """Import on first use (PEP 562), so that `import cruise` does not wait for JAX."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES.get(name, "cruise.api")), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
