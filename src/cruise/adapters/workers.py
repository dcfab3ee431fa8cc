"""How an environment starts JAX in the process that flies it, and in none before."""

import os
import sys

from cruise.compilation_cache import use_compilation_cache
from cruise.errors import CruiseError
from cruise.processor import use_wide_vectors

_ran_in: int | None = None  # the process that had JAX running when it forked this one


def _jax_runs() -> bool:
    """Whether this process has started JAX's backends: JAX says so in a private module alone."""
    bridge = sys.modules.get("jax._src.xla_bridge")
    return bool(getattr(bridge, "_backends", None))


def _note() -> None:
    global _ran_in  # noqa: PLW0603  (what a fork leaves behind)
    _ran_in = os.getpid() if _jax_runs() else None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_note)


def start_jax() -> None:
    """Settle what must be before JAX first compiles.

    Raises:
        CruiseError: this process was forked from one in which JAX was running: it would wait for ever.
    """
    if _ran_in is not None and _ran_in != os.getpid():
        raise CruiseError(
            "JAX was running when this process was forked, and cannot run here: reset no environment before workers "
            "are forked, or start them by 'spawn' or 'forkserver'"
        )
    if not _jax_runs():
        use_wide_vectors()
        use_compilation_cache()
