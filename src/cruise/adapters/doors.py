"""What `import cruise` offers of the adapters, without waiting for the libraries behind them."""

import importlib
from typing import TYPE_CHECKING, Any

from cruise.errors import CruiseError
from cruise.extras import how_to_install

if TYPE_CHECKING:
    from cruise.adapters.pettingzoo_env import ParallelRaceEnv
    from cruise.adapters.pettingzoo_vector import VectorParallelRaceEnv

__all__ = ["parallel_env", "vector_parallel_env"]


def parallel_env(**options: Any) -> "ParallelRaceEnv":
    """A race in which every drone is an agent, as PettingZoo's parallel environment.

    Args:
        options: as `RaceOptions` has them, such as `track="ring"`, `drones=4`, `stage="race"`; and `render_mode`.

    Raises:
        CruiseError: the options do not go together, or PettingZoo is not installed.
    """
    return adapter("cruise.adapters.pettingzoo_env").ParallelRaceEnv(**options)


def vector_parallel_env(num_envs: int, **options: Any) -> "VectorParallelRaceEnv":
    """Many such races in one compiled step: arrays [E, ...] in place of single values.

    Args:
        num_envs: number of races E.
        options: as for `parallel_env`, without `render_mode`.

    Raises:
        CruiseError: as `parallel_env`.
    """
    return adapter("cruise.adapters.pettingzoo_vector").VectorParallelRaceEnv(num_envs, **options)


def adapter(name: str) -> Any:
    """A module of this package, or of a library behind it. Raises CruiseError where the library is not installed."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        library = (error.name or "").partition(".")[0]
        if library not in ("gymnasium", "pettingzoo"):
            raise
        raise CruiseError(f"{library} is not installed: {how_to_install('gym')}") from None
