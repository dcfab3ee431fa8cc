"""Libraries that only an extra of the package installs."""

import importlib
from typing import Any

from cruise.errors import CruiseError


def import_extra(module: str, extra: str, need: str) -> Any:
    """The module of a library. Raises CruiseError with the `need` ("X needs Y") where its extra is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise CruiseError(f"{need}: pip install 'cruise-racing[{extra}]'") from None
