"""Compiled programs, kept from one process to the next."""

import contextlib
import os
from pathlib import Path

LEAST_SECONDS = 0.1  # what compiles faster is compiled anew


def use_compilation_cache() -> None:
    """Keep what JAX compiles in the user's cache folder, unless JAX was told of another or this cannot be written."""
    import jax  # noqa: PLC0415  (slow to import; `cruise --help` must not wait for it)

    if jax.config.values["jax_compilation_cache_dir"] is not None:
        return
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: there is no home folder
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cruise" / "jax"
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            jax.config.update("jax_compilation_cache_dir", str(folder))
            jax.config.update("jax_persistent_cache_min_compile_time_secs", LEAST_SECONDS)
