"""Progress of a study: bars in a terminal, plain lines elsewhere."""

import time
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from cruise.reproduction.plan import Job
    from cruise.reproduction.study import Event

LINE_SECONDS = 30.0  # between plain lines on one job


def show_events(console: Console, events: "Iterable[Event]", jobs: "Sequence[Job]", planned: int) -> int:
    """Show a study until it ends. Gives 1 where a job failed, else 0."""
    console.print(f"{planned - len(jobs)} of {planned} done before, {len(jobs)} to run")
    shown = _bars(console, events, len(jobs)) if console.is_terminal else _lines(console, events, len(jobs))
    failed = [event.job.name for event in shown if event.what == "failed"]
    if failed:
        console.print(
            f"{len(failed)} failed: {escape(', '.join(failed))}; the same command tries again", soft_wrap=True
        )
    return 1 if failed else 0


def _outcome(event: "Event") -> str:
    told = f"done in {event.seconds:.0f} s" if event.what == "done" else f"{event.what}: {event.message}"
    return f"{event.job.name}: {told}"


def _lines(console: Console, events: "Iterable[Event]", total: int) -> "Iterator[Event]":
    """A line per outcome, and one every half minute."""
    number, last = 0, time.monotonic()
    for event in events:
        if event.what == "started":
            number, last = number + 1, time.monotonic()
        elif event.what != "step":
            console.print(escape(f"[{number}/{total}] {_outcome(event)}"), soft_wrap=True)
        elif time.monotonic() - last > LINE_SECONDS:
            last = time.monotonic()
            console.print(escape(f"[{number}/{total}] {event.job.name}: {_describe(event)}"), soft_wrap=True)
        yield event


def _describe(event: "Event") -> str:
    step = event.step
    return f"{step.doing} {step.done / step.total:.0%}" if step.total else step.doing


def _bars(console: Console, events: "Iterable[Event]", total: int) -> "Iterator[Event]":
    """One bar for the study, one for the job at hand."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[doing]}"), TimeElapsedColumn())
    with Progress(*columns, console=console) as bars:
        study = bars.add_task("study", total=total, doing=f"0 of {total}")
        job = bars.add_task("", total=None, doing="")
        finished = 0
        for event in events:
            if event.what == "started":
                bars.reset(job, description=escape(event.job.name), total=None, doing="starting")
            elif event.what == "step":
                step = event.step
                bars.update(job, completed=step.done, total=step.total or None, doing=_describe(event))
            else:
                finished += 1
                bars.update(study, completed=finished, doing=f"{finished} of {total}")
                bars.console.print(escape(_outcome(event)), soft_wrap=True)
            yield event
