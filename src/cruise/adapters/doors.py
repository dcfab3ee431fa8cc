"""What `import cruise` offers of the adapters, without waiting for the libraries behind them."""

import importlib
from typing import TYPE_CHECKING, Any

from cruise.errors import CruiseError

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
    return _adapter("pettingzoo_env").ParallelRaceEnv(**options)


def vector_parallel_env(num_envs: int, **options: Any) -> "VectorParallelRaceEnv":
    """Many such races in one compiled step: arrays [E, ...] in place of single values.

    Args:
        num_envs: number of races E.
        options: as for `parallel_env`, without `render_mode`.

    Raises:
        CruiseError: as `parallel_env`.
    """
    return _adapter("pettingzoo_vector").VectorParallelRaceEnv(num_envs, **options)


def _adapter(name: str) -> Any:
    try:
        return importlib.import_module(f"cruise.adapters.{name}")
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] not in ("gymnasium", "pettingzoo", "PIL"):
            raise
        raise CruiseError(f"{error.name} is not installed: pip install 'cruise-racing[gym]'") from None
