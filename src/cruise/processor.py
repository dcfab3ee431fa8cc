"""What is asked of the processor: wide vectors before JAX first compiles, a core at once where a person flies."""

import os
from pathlib import Path

WIDTH = "xla_cpu_prefer_vector_width"


def use_wide_vectors() -> None:
    """Let compiled programs use vectors of 512 bits on processors that have them: left alone, XLA stops at 256.

    Its flags are read once, when it first compiles; after that this changes nothing. What the user says of the width in
    XLA_FLAGS stands. Sums are rounded in another order than with narrow vectors.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if WIDTH not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{WIDTH}=512".strip()


def run_in_real_time() -> bool:
    """Let all threads of this process have a core as soon as they need one; whether the system allows it.

    Linux does so for root, and for whom its limits give a real-time priority (`ulimit -r`). Others share cores, and
    a browser that draws by software leaves steps to wait. Processes that are started later are as others are.
    """
    try:
        for thread in Path("/proc/self/task").iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(1))
    except (AttributeError, OSError):
        return False
    return True
