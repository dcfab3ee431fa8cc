"""Terms of a user: a Python file that declares OBSERVATIONS, REWARDS, or both. Its code is run, as was asked for.

Nothing that is stored names the file: whoever flies or trains with such terms gives it again.
"""

import functools
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from cruise.env.observation import add_observation
from cruise.env.payment import add_reward_term
from cruise.errors import CruiseError
from cruise.pilots.loader import load_module
from cruise.terms import Observation, RewardTerm

StrPath = str | os.PathLike[str]
LISTS = {"OBSERVATIONS": Observation, "REWARDS": RewardTerm}


class Declared(NamedTuple):
    """What a file declares."""

    observations: tuple[Observation, ...]
    rewards: tuple[RewardTerm, ...]


def load_terms(path: StrPath) -> Declared:
    """Run a file and make its observations and reward terms known by their names, in this process.

    Args:
        path: of a Python file with `OBSERVATIONS = [Observation(...)]`, `REWARDS = [RewardTerm(...)]`, or both.

    Raises:
        CruiseError: there is no such file, it cannot be run, it declares neither, or a name is taken.
    """
    name = os.fspath(path)
    if not name.endswith(".py"):
        raise CruiseError(f"a file of terms is Python: expected FILE.py, got {name!r}")
    try:
        status = os.stat(name)
    except OSError:
        raise CruiseError(f"terms file {name} does not exist") from None
    declared = _run(str(Path(name).resolve()), status.st_mtime_ns, status.st_size)
    for observation in declared.observations:
        add_observation(observation)
    for term in declared.rewards:
        add_reward_term(term)
    if name not in LOADED:
        LOADED.append(name)
    return declared


def load_all_terms(paths: Iterable[StrPath]) -> tuple[str, ...]:
    """Load several files, and give the names of the reward terms that they declare."""
    return tuple(term.name for path in paths for term in load_terms(path).rewards)


LOADED: list[str] = []  # files, in the order in which they were loaded


@functools.lru_cache(maxsize=32)
def _run(path: str, changed: int, size: int) -> Declared:
    """Once as long as the file stays as it is, so that what was compiled for its terms is found again."""
    del changed, size
    module = load_module(path, "terms")
    found = {name: tuple(_listed(path, name, getattr(module, name, ()), kind)) for name, kind in LISTS.items()}
    if not any(found.values()):
        raise CruiseError(f"terms file {path} declares neither OBSERVATIONS = [...] nor REWARDS = [...]")
    return Declared(found["OBSERVATIONS"], found["REWARDS"])


def _listed(path: str, name: str, value: Any, kind: type) -> Iterable[Any]:
    if not isinstance(value, list | tuple):
        raise CruiseError(f"terms file {path}: {name} is a list of {kind.__name__}, not of type {type(value).__name__}")
    wrong = next((one for one in value if not isinstance(one, kind)), None)
    if wrong is not None:
        raise CruiseError(f"terms file {path}: {name} holds a {type(wrong).__name__}, expected {kind.__name__}")
    return value
