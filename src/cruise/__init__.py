"""CRUISE: learning to race drones against drones."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cruise.adapters.doors import parallel_env, vector_parallel_env
    from cruise.adapters.functional_agents import make
    from cruise.api import evaluate, load_policy, load_track, race, replay
    from cruise.api_training import train
    from cruise.config import Firmware, InSimulator, Sensing, Vehicle
    from cruise.env.observation import find_observation
    from cruise.errors import CruiseError
    from cruise.pilots.terms_file import load_terms
    from cruise.racing.random_track import random_track
    from cruise.terms import Observation, RewardTerm, Setting, Term
    from cruise.vehicles import load_vehicle

__version__ = "0.1.0"

__all__ = [
    "CruiseError",
    "Firmware",
    "InSimulator",
    "Observation",
    "RewardTerm",
    "Sensing",
    "Setting",
    "Term",
    "Vehicle",
    "__version__",
    "evaluate",
    "find_observation",
    "load_policy",
    "load_terms",
    "load_track",
    "load_vehicle",
    "make",
    "parallel_env",
    "race",
    "random_track",
    "replay",
    "train",
    "vector_parallel_env",
]

_HOMES = {
    "CruiseError": "cruise.errors",
    "Firmware": "cruise.config",
    "InSimulator": "cruise.config",
    "Observation": "cruise.terms",
    "RewardTerm": "cruise.terms",
    "Sensing": "cruise.config",
    "Setting": "cruise.terms",
    "Term": "cruise.terms",
    "find_observation": "cruise.env.observation",
    "load_terms": "cruise.pilots.terms_file",
    "Vehicle": "cruise.config",
    "load_vehicle": "cruise.vehicles",
    "make": "cruise.adapters.functional_agents",
    "parallel_env": "cruise.adapters.doors",
    "random_track": "cruise.racing.random_track",
    "train": "cruise.api_training",
    "vector_parallel_env": "cruise.adapters.doors",
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
