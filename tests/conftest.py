"""Every test runs on the CPU, with annotations that are checked and compilations that are kept.

This must run before anything imports `cruise` or JAX: the settings are read, and the modules instrumented, at import.
"""

import os
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent

os.environ["JAX_PLATFORMS"] = "cpu"
os.environ["JAX_NUM_CPU_DEVICES"] = "4"  # for training on several
os.environ["MPLBACKEND"] = "agg"
# Tests compile much and compute little. Processes that they start inherit it, so all compute the same bits.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")  # nobody asks which line an operation comes from
# As the commands compile, so that a process of theirs and this one compute the same bits. The others take two thirds
# off the time to compile: the older code generator, and programs in one piece instead of 32.
COMPILER = ("cpu_prefer_vector_width=512", "cpu_use_fusion_emitters=false", "cpu_parallel_codegen_split_count=1")
# These look long for what makes no difference to a bit and is worth little in a program that runs once.
LEFT_OUT = (
    "simplify-while-loops",
    "while-loop-invariant-code-motion",
    "while-loop-constant-sinking",
    "while-loop-trip-count-annotator",
    "reshape-mover",
    "tree_reduction_rewriter",
    "dynamic-dimension-simplifier",
    "cpu-parallel-task-assigner",
    "constant_folding",
)
os.environ["XLA_FLAGS"] = " ".join(
    [
        os.environ.get("XLA_FLAGS", ""),
        *(f"--xla_{flag}" for flag in COMPILER),
        f"--xla_disable_hlo_passes={','.join(LEFT_OUT)}",
    ]
).strip()
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(ROOT / ".jax_cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")

import contextlib
import ctypes
import gc

import jax
import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

from tests import annotations

install_import_hook("cruise", f"{annotations.__name__}.checked")

# No deadline: the first example compiles. In CI the same examples every time.
settings.register_profile("cruise", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("cruise")

gc.set_threshold(50_000, 5, 5)  # tracing makes many objects, of which few are garbage: seldom is often enough

MOST_MEMORY = 1.4e9  # of a worker between two tests [bytes]
MOST_MAPPINGS = 20_000  # of its memory: every compiled program has some, and Linux ends a process at 65,530
# Folders, and files beside them, whose tests take longest begin first, so that no worker ends long after the others.
LONGEST = (
    "docs",
    "training",
    "limit",
    "test_combinations.py",
    "pilots",
    "export",
    "env",
    "cli",
    "racing",
    "experiments",
    "adapters",
    "evaluation",
    "viewer",
    "dynamics",
)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A folder's tests run in one process, one after the other: they share what is compiled."""
    from xdist.scheduler import LoadFileScheduling

    class ByFolder(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return _folder(nodeid)

    return ByFolder(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest first."""
    order = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(_folder(item.nodeid), len(order)))


def pytest_collection_finish() -> None:
    """What is there by now stays: no collection of garbage looks at it again."""
    gc.collect()
    gc.freeze()


def _folder(nodeid: str) -> str:
    """Of a test; a file beside the folders is one of its own."""
    return nodeid.partition("::")[0].split("/")[1]


_held = [0.0]  # after programs were last let go [bytes]


@pytest.fixture(autouse=True)
def _little_memory():
    """Compiled programs pile up from test to test: they are let go before memory runs out.

    Not after every test where something else holds as much: each would compile anew.
    """
    yield
    most = max(MOST_MEMORY, _held[0] + 0.4e9)
    if _resident() > most:
        _let_go()
    if _resident() > most:
        _forget_programs()
        _held[0] = _resident()


@pytest.fixture(autouse=True, scope="module")
def _few_mappings():
    """Or before its mappings do."""
    yield
    if _mappings() > MOST_MAPPINGS:
        _forget_programs()


def _forget_programs() -> None:
    """Compiled ones, and all that only they hold."""
    jax.clear_caches()
    _let_go()


def _let_go() -> None:
    """Garbage; what was freed goes back to the system, where its C library can be told so."""
    gc.collect()
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)


def _resident() -> float:
    """Memory of this process [bytes]; 0 where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0.0
    return float(pages * os.sysconf("SC_PAGE_SIZE"))


def _mappings() -> int:
    """Of this process's memory; 0 where the system does not say."""
    try:
        return Path("/proc/self/maps").read_text().count("\n")
    except OSError:
        return 0
