"""Libraries that only an extra of the package installs."""

import importlib
import importlib.metadata
import re
from typing import Any

from cruise.errors import CruiseError

PACKAGE = "cruise-racing"


def import_extra(module: str, extra: str, need: str) -> Any:
    """The module of a library. Raises CruiseError with the `need` ("X needs Y") where its extra is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise CruiseError(f"{need}: {how_to_install(extra)}") from None


def how_to_install(extra: str) -> str:
    """The command that installs what an extra names, wherever CRUISE itself came from."""
    try:
        required = importlib.metadata.requires(PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:  # run from a folder of sources
        required = []
    wanted = [line.partition(";")[0].strip() for line in required if re.search(rf"extra == .{extra}\b", line)]
    return "pip install " + (" ".join(f"'{one}'" for one in wanted) or f"-e '.[{extra}]' in the folder of CRUISE")
