"""Everything is computed in single precision: policies were trained in it, and it is what they are stored in."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import jax

P = ParamSpec("P")
T = TypeVar("T")


def use_single_precision() -> None:
    """From here on, in this process, whatever JAX_ENABLE_X64 says."""
    jax.config.update("jax_enable_x64", False)


def single_precision(function: Callable[P, T]) -> Callable[P, T]:
    """The function, which computes so also where the user has switched double precision on for computations of his."""

    @functools.wraps(function)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> T:
        with jax.enable_x64(False):
            return function(*args, **kwargs)

    return wrapped
