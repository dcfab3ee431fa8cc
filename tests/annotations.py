"""How annotations are checked in the tests: as mypy reads them, an `int` may stand where a `float` is asked for."""

from collections.abc import Callable
from typing import Any

from beartype import BeartypeConf, beartype

_checked = beartype(conf=BeartypeConf(is_pep484_tower=True))


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Checks a function that stands for another: jaxtyping makes two, for what goes in and for what comes out.

    It calls both, one after the other, and the second would look again at all that goes in.
    """
    result = function.__annotations__.get("return", Any)
    if result is not Any:
        function.__annotations__ = {"return": result}
    return _checked(function)
