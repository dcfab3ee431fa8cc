"""`cruise reproduce` and `cruise sweep`: they live in `experiments/` beside `src/`, which only a checkout has."""

import importlib
import pickle
import sys
from pathlib import Path
from typing import Any

import cruise
from cruise.errors import CruiseError

COMMANDS = {"Reproduce", "Sweep"}


def __getattr__(name: str) -> Any:
    """The dataclass of a command. Raises CruiseError where there is no checkout."""
    if name not in COMMANDS:
        raise AttributeError(name)
    find()
    return getattr(importlib.import_module("experiments.cli"), name)


def find() -> None:
    """Make the package `experiments` importable. Raises CruiseError where there is no checkout."""
    checkout = Path(cruise.__file__).parents[2]
    if not (checkout / "experiments" / "cli.py").is_file():
        raise CruiseError(
            "`cruise reproduce` and `cruise sweep` need a checkout of CRUISE with its package installed from there: "
            "pip install -e ."
        )
    if str(checkout) not in sys.path:
        sys.path.append(str(checkout))


def call(pickled: bytes) -> Any:
    """Call a function of the experiments with its arguments, in a worker that has imported the package alone."""
    find()
    function, arguments = pickle.loads(pickled)
    return function(*arguments)
