"""Other learning libraries on the races: the snippets of docs/clients.md, and then the library's own learner.

`make clients` installs the libraries, some of which exclude each other's versions, and runs this in each environment.
Each line is one library: environment steps, how many come in a second of processor time once all is compiled, and the
processor time with all that the library imports and compiles.
"""

import importlib.metadata
import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks import clients_learn

PAGE = Path(__file__).parent.parent / "docs" / "clients.md"
SNIPPET = re.compile(r"^### (.+?)\n.*?^```py\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# By heading of the page: the environment of `make clients`, the package whose version is told, and what learns in what
# the snippet has made; None: the snippet does itself.
CLIENTS: dict[str, tuple[str, str, Callable[[dict[str, Any]], Any] | None]] = {
    "CleanRL": ("torch", "torch", clients_learn.as_cleanrl),
    "Stable-Baselines3": ("torch", "stable-baselines3", None),
    "sb3-contrib": ("torch", "sb3-contrib", None),
    "SBX": ("torch", "sbx-rl", None),
    "SuperSuit": ("torch", "SuperSuit", clients_learn.supersuit),
    "TorchRL": ("torch", "torchrl", clients_learn.torchrl),
    "TorchRL, every drone": ("torch", "torchrl", clients_learn.torchrl_agents),
    "skrl": ("torch", "skrl", clients_learn.skrl),
    "skrl, every drone": ("torch", "skrl", clients_learn.skrl_agents),
    "PettingZoo's checks": ("torch", "pettingzoo", None),
    "Gymnasium's check": ("torch", "gymnasium", None),
    "Tianshou": ("tianshou", "tianshou", clients_learn.tianshou),
    "RLlib": ("rllib", "ray", clients_learn.rllib),
    "RLlib, every drone": ("rllib", "ray", clients_learn.rllib),
    "AgileRL": ("agile", "agilerl", clients_learn.agilerl),
    "JaxMARL": ("jaxmarl", "jaxmarl", clients_learn.jaxmarl),
    "gymnax and PureJaxRL": ("jaxmarl", "gymnax", clients_learn.gymnax),
}
WARM = 0.2  # of the steps are not timed


def snippets() -> dict[str, str]:
    """The page's blocks by heading."""
    return {match[1]: match[2] for match in SNIPPET.finditer(PAGE.read_text())}


def run(name: str) -> str:
    """Run a client here; what it did, in words."""
    count = _counted()
    names: dict[str, Any] = {"__name__": name}
    exec(compile(snippets()[name], f"{PAGE.name}: {name}", "exec"), names)
    learn = CLIENTS[name][2]
    told = learn(names) if learn else None
    steps, rate = told or count()
    return f"{steps:>7,} steps, {rate:>9,.0f} steps/s"


def _counted() -> Callable[[], tuple[int, float]]:
    """Counts the steps of learners through NumPy's doors from now on, in forked processes, too."""
    from cruise.adapters.races import Races  # noqa: PLC0415

    seen = get_context("fork").Array("d", 3)  # steps, and steps and time where timing began
    step, here = Races.step, os.getpid()

    def counted(self: Races, actions: Any) -> Any:
        stepped = step(self, actions)
        with seen.get_lock():
            seen[0] += stepped.active.sum()
            if not seen[2] and seen[0] >= WARM * clients_learn.STEPS:
                seen[1:3] = [seen[0], clients_learn.used(here)]
        return stepped

    Races.step = counted  # type: ignore[method-assign]
    return lambda: (int(seen[0]), (seen[0] - seen[1]) / (clients_learn.used(here) - seen[2]) if seen[2] else 0.0)


def _processor_seconds() -> float:
    """Of all processes that this one has waited for."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """The clients of some groups, or with such names, each in a process of its own; 1 where one fails."""
    failed = 0
    for name in [name for name in CLIENTS if {name, CLIENTS[name][0]} & set(sys.argv[1:])]:
        package = CLIENTS[name][1]
        version = importlib.metadata.version(package)
        code, before = f"from benchmarks.clients import run; print(run({name!r}))", _processor_seconds()
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        seconds = _processor_seconds() - before
        failed_by = re.findall(r"^[\w.]*(?:Error|Exception)\b.*", done.stderr, re.MULTILINE)[-1:]
        said = f"FAILED: {failed_by}" if done.returncode else done.stdout.strip().splitlines()[-1]
        print(f"{name:22} {package} {version}: {said}, {seconds:.0f} s of processor time", flush=True)
        failed += done.returncode != 0
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
