"""Progress of a study: bars in a terminal, plain lines elsewhere."""

import time
from collections.abc import Iterable, Iterator, Sequence

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from experiments.plan import Job
from experiments.study import Event

LINE_SECONDS = 30.0  # between plain lines on one job


def show_events(console: Console, events: Iterable[Event], jobs: Sequence[Job], planned: int) -> int:
    """Show a study until it ends. Gives 1 where a job failed, else 0. Ctrl-C says what it means."""
    console.print(f"{planned - len(jobs)} of {planned} done before, {len(jobs)} to run")
    shown = _bars(console, events, _Ahead(jobs)) if console.is_terminal else _lines(console, events, _Ahead(jobs))
    try:
        failed = [event.job.name for event in shown if event.what == "failed"]
    except KeyboardInterrupt:
        raise KeyboardInterrupt("stopped; what is done is kept, and the same command goes on") from None
    if failed:
        names = ", ".join(failed)
        console.print(f"{len(failed)} failed: {names}; the same command tries again", soft_wrap=True, markup=False)
    return 1 if failed else 0


class _Ahead:
    """What is still to run, and how long that may take: as long as jobs of the same sort took so far."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self.jobs, self.total = list(jobs), len(jobs)
        self._seconds: dict[str, list[float]] = {}

    def finish(self, event: Event) -> None:
        """Take note of a job's outcome."""
        self.jobs = [job for job in self.jobs if job != event.job]
        if event.what == "done":
            self._seconds.setdefault(event.job.family, []).append(event.seconds)

    @property
    def text(self) -> str:
        """So many of so many, and the time left where it can be told."""
        place = f"{self.total - len(self.jobs)} of {self.total}"
        means = {family: sum(seconds) / len(seconds) for family, seconds in self._seconds.items()}
        if not self.jobs or not means:
            return place
        usual = max(means.values())
        minutes = sum(means.get(job.family, usual) for job in self.jobs) / 60
        return f"{place}, about {f'{minutes / 60:.1f} h' if minutes > 90 else f'{minutes:.0f} min'} left"


def _outcome(event: Event) -> str:
    told = f"done in {event.seconds:.0f} s" if event.what == "done" else f"{event.what}: {event.message}"
    return f"{event.job.name}: {told}"


def _describe(event: Event) -> str:
    step = event.step
    return f"{step.doing} {step.done / step.total:.0%}" if step.total else step.doing


def _lines(console: Console, events: Iterable[Event], ahead: _Ahead) -> Iterator[Event]:
    """A line per outcome, and one every half minute."""
    last = time.monotonic()
    for event in events:
        text = ""
        if event.what == "started":
            last = time.monotonic()
        elif event.what != "step":
            ahead.finish(event)
            text = f"{_outcome(event)} ({ahead.text})"
        elif time.monotonic() - last > LINE_SECONDS:
            last = time.monotonic()
            text = f"{event.job.name}: {_describe(event)}"
        if text:
            console.print(text, soft_wrap=True, markup=False)
        yield event


def _bars(console: Console, events: Iterable[Event], ahead: _Ahead) -> Iterator[Event]:
    """One bar for the study, one for the job at hand."""
    name, doing = (TextColumn(text, markup=False) for text in ("{task.description}", "{task.fields[doing]}"))
    columns = (name, BarColumn(), doing, TimeElapsedColumn())
    with Progress(*columns, console=console) as bars:
        study = bars.add_task("study", total=ahead.total, doing=ahead.text)
        job = bars.add_task("", total=None, doing="")
        for event in events:
            if event.what == "started":
                bars.reset(job, description=event.job.name, total=None, doing="starting")
            elif event.what == "step":
                bars.update(job, completed=event.step.done, total=event.step.total or None, doing=_describe(event))
            else:
                ahead.finish(event)
                bars.update(study, completed=ahead.total - len(ahead.jobs), doing=ahead.text)
                bars.console.print(_outcome(event), soft_wrap=True, markup=False)
            yield event
