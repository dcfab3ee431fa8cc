"""A case in a process of its own, by another Python: for libraries that need other versions than CRUISE's.

The child builds the case, says how much work a call is, and does it whenever it reads a line.
"""

import importlib
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]


class Apart:
    """A case `MODULE:FUNCTION`, built and called by the interpreter `python`."""

    def __init__(self, python: str, case: str) -> None:
        """Start the process and wait until the case is built. Raises ImportError where its library is missing."""
        environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'src'}"}
        try:
            self._child = subprocess.Popen(
                [python, "-m", "benchmarks.peers.apart", case],
                cwd=ROOT,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        except FileNotFoundError:
            raise ModuleNotFoundError(f"no {python}", name=python) from None
        answer = self._answer()
        if answer.startswith("missing "):
            raise ModuleNotFoundError(answer, name=answer.removeprefix("missing "))
        self.work, self.used = float(answer.removeprefix("work ")), 0.0

    def __call__(self) -> None:
        """Have it done once."""
        assert self._child.stdin is not None
        self._child.stdin.write("go\n")
        self._child.stdin.flush()
        self.used = float(self._answer().removeprefix("done "))  # processor time [s]

    def _answer(self) -> str:
        assert self._child.stdout is not None
        line = self._child.stdout.readline().strip()
        if not line:
            raise RuntimeError(f"{' '.join(map(str, self._child.args))} ended with exit code {self._child.wait()}")
        return line


def main(case: str) -> None:
    """The child: answers go where standard output was, and everything else to standard error."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def answer(line: str) -> None:
        print(line, file=answers, flush=True)

    module, function = case.split(":")
    try:
        work = getattr(importlib.import_module(module), function)()
    except ImportError as missing:
        answer(f"missing {missing.name}")
        return
    answer(f"work {work.work}")
    for _ in sys.stdin:
        began = time.process_time()
        work()
        answer(f"done {time.process_time() - began}")


if __name__ == "__main__":
    main(sys.argv[1])
