"""Cores of this machine that a process keeps to itself while others keep to theirs."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from cruise.storage.file_lock import Busy, locked


@contextlib.contextmanager
def own_cores(count: int) -> Iterator[frozenset[int]]:
    """Run on `count` cores that no other process has taken this way; gives them, or nothing where none are held.

    Trainings that share cores wait at their loops for threads of each other. Whoever JAX starts under finds only the
    cores that are held. Where too few are free, or the system holds no process to a core, everything stays as it is.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield frozenset()
        return
    before = os.sched_getaffinity(0)
    with contextlib.ExitStack() as stack:
        taken = frozenset(_take(sorted(before), count, stack))
        if len(taken) == count:
            os.sched_setaffinity(0, taken)
            stack.callback(os.sched_setaffinity, 0, before)
        else:  # others may want what there is
            stack.close()
            taken = frozenset()
        yield taken


def _take(cores: list[int], count: int, stack: contextlib.ExitStack) -> Iterator[int]:
    """Up to `count` of the cores that nobody has, each as a locked file: a process that dies lets go of it."""
    folder = Path(tempfile.gettempdir()) / f"cruise-cores-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    for core in cores:
        if count == 0:
            return
        try:
            stack.enter_context(locked(folder / str(core)))
        except Busy:
            continue
        count -= 1
        yield core
