"""Running the plan: a generator that says what happens, job by job; it prints nothing."""

import gc
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Literal, NamedTuple

import jax

from cruise.errors import CruiseError
from cruise.storage.file_lock import Busy
from experiments.head_to_head import checksums, make_head_to_head
from experiments.learned import make_learned, make_planner
from experiments.plan import Family, Job
from experiments.results import HeadToHead
from experiments.settings import is_current
from experiments.work import Step, Work

State = Literal["done", "other settings", "broken", "not run"]


class Event(NamedTuple):
    """Something that happened in a study."""

    job: Job
    what: Literal["started", "step", "done", "busy", "failed"]
    step: Step = Step("")
    message: str = ""  # why it failed
    seconds: float = 0.0  # that a finished job took now


MAKERS: dict[Family, Callable[[Work, Job], Iterator[Step]]] = {
    "learned": make_learned,
    "planner": make_planner,
    "head-to-head": make_head_to_head,
}


def state_of(work: Work, job: Job) -> State:
    """Whether a job's result is there."""
    try:
        result = work.results.read(job)
    except CruiseError:
        return "broken"
    if result is None:
        return "not run"
    if isinstance(result, HeadToHead):
        current = result.policies == checksums(work, job)
    else:
        current = is_current(result, job, work.scale)
    return "done" if current else "other settings"


def left(work: Work, jobs: Sequence[Job], again: bool = False) -> tuple[Job, ...]:
    """Jobs that have no result yet; with `again`, those too whose result was made with other settings or is broken."""
    wanted = ("not run", "other settings", "broken") if again else ("not run",)
    return tuple(job for job in jobs if state_of(work, job) in wanted)


def run_jobs(work: Work, jobs: Sequence[Job]) -> Iterator[Event]:
    """Run jobs in order. One that fails does not stop the others, and one that another process runs is left to it.

    Raises:
        KeyboardInterrupt: Ctrl-C; what is done is kept, the job at hand goes on when it is run again.
    """
    for job in jobs:
        if state_of(work, job) == "done":  # by another process, since the list was made
            continue
        started = time.monotonic()
        yield Event(job, "started")
        try:
            with work.lock(job):
                for step in MAKERS[job.family](work, job):
                    yield Event(job, "step", step)
        except Busy as error:
            yield Event(job, "busy", message=str(error))
        except CruiseError as error:
            yield Event(job, "failed", message=str(error))
        else:
            yield Event(job, "done", seconds=time.monotonic() - started)
        jax.clear_caches()  # a study compiles more programs than memory should hold
        gc.collect()
