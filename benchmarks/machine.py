"""The machine a benchmark ran on, what it can do, and how its time is taken."""

import os
import platform
import resource
import statistics
import sys
import time
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

from benchmarks.roofline import Cost
from cruise import __version__
from cruise.training.devices import AXIS, make_mesh

# Sides of the matrices that are multiplied, and bytes copied, more than any cache holds: a few milliseconds' work.
PRODUCTS = {"cpu": (1024, 2048), "gpu": (4096, 8192)}
COPIED = {"cpu": 2**28, "gpu": 2**32}
LEAST_ROUNDS = 3  # whatever the time limit


class Case(Protocol):
    """Something to time: a call does `work` units of it and returns when they are done."""

    work: float

    def __call__(self) -> None:
        """Do it once."""


class CostedCase(Case, Protocol):
    """A case of which is known what it costs."""

    @property
    def cost(self) -> Cost:
        """Of one unit."""


class Matmul:
    """A square product in float32. Its unit is the floating-point operation."""

    def __init__(self, size: int) -> None:
        """Compile it for matrices of `size` x `size`."""
        self.work = 2.0 * size**3
        self._matrix = jnp.asarray(np.random.default_rng(size).standard_normal((size, size)), jnp.float32)
        self._product = jax.jit(jnp.matmul).lower(self._matrix, self._matrix).compile()

    def __call__(self) -> None:
        """Multiply once."""
        jax.block_until_ready(self._product(self._matrix, self._matrix))


class Copy:
    """Going once over an array that lies in memory, every device over its part. Its unit is the byte, read or written.

    Results lie where operands lay: fresh memory for them would cost several times as much.
    """

    def __init__(self, size: int | None = None) -> None:
        """Compile it for an array of `size` bytes on all devices."""
        size = size or COPIED[platform_kind()]
        spread = NamedSharding(make_mesh(jax.devices()), PartitionSpec(AXIS))
        self._array = jax.device_put(np.ones((len(jax.devices()), size // 4 // len(jax.devices())), np.float32), spread)
        self.work = 2.0 * self._array.nbytes
        self._negate = jax.jit(jnp.negative, donate_argnums=0).lower(self._array).compile()

    def __call__(self) -> None:
        """Once."""
        self._array = jax.block_until_ready(self._negate(self._array))


def platform_kind() -> str:
    """Of the devices that JAX computes on: "cpu" or "gpu"."""
    return "cpu" if jax.devices()[0].platform == "cpu" else "gpu"


def interleave(cases: Mapping[str, Case], rounds: int, seconds: float) -> dict[str, list[float]]:
    """Seconds of every call: round after round, in each of them every case once.

    Whatever else the machine does in the meantime falls on all cases alike. A first round is not counted: it warms
    caches. Ends after `rounds`, or sooner when `seconds` have passed and three rounds are complete.
    """
    for case in cases.values():
        case()
    taken: dict[str, list[float]] = {name: [] for name in cases}
    started = time.perf_counter()
    for done in range(rounds):
        if done >= LEAST_ROUNDS and time.perf_counter() - started > seconds:
            break
        for name, case in cases.items():
            before = time.perf_counter()
            case()
            taken[name].append(time.perf_counter() - before)
    return taken


def rates(cases: Mapping[str, Case], taken: Mapping[str, list[float]]) -> dict[str, float]:
    """Units of work per second of each case, by the median of its rounds."""
    return {name: case.work / statistics.median(taken[name]) for name, case in cases.items()}


def peak_memory_mb() -> float:
    """The most memory this process has held so far [MB].

    Linux keeps `ru_maxrss` across `exec`, so that a child inherits the peak of the process that started it; `VmHWM` is
    the process's own.
    """
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    own = [line.split()[1] for line in lines if line.startswith("VmHWM")]
    if own:
        return int(own[0]) * 1024 / 1e6
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def available_memory_mb() -> float:
    """Memory that can still be had [MB]; where nobody says, half of what is built in."""
    meminfo = Path("/proc/meminfo")
    lines = meminfo.read_text().splitlines() if meminfo.exists() else []
    free = [line.split()[1] for line in lines if line.startswith("MemAvailable")]
    if free:
        return int(free[0]) * 1024 / 1e6
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2e6


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def describe_machine() -> dict[str, object]:
    """Processor, system, device of JAX, and how busy it all was before the benchmark."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": models[0] if models else platform.processor() or platform.machine(),
        "system": f"{platform.system()} {platform.machine()}",
        "device": jax.devices()[0].device_kind,
        "load_average": [round(load, 2) for load in os.getloadavg()],
    }


def versions() -> dict[str, str]:
    """What was measured, and with what."""
    packages = {name: version(name) for name in ("jax", "jaxlib", "numpy")}
    return {"cruise": __version__, "python": platform.python_version()} | packages
