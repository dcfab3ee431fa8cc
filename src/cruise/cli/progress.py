"""Progress of a training run: a live panel in a terminal, plain lines elsewhere."""

import math
import time
from collections import deque
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from cruise.config import TrainConfig

if TYPE_CHECKING:
    from cruise.training.trainer import Progress as Update

RATE_UPDATES = 40  # over which the rate is taken
LINE_SECONDS = 10.0  # between plain lines, stage ends apart


class Screen(AbstractContextManager["Screen"]):
    """Shows updates; entered before training, left after it."""

    def __init__(self, console: Console, config: TrainConfig, total_steps: int) -> None:
        """Nothing appears before the first update."""
        self.console, self.total_steps = console, total_steps
        self.title = f"{config.track}, {config.drones} drone{'s' if config.drones > 1 else ''}, seed {config.seed}"
        self._clock = _Clock()
        self._evaluation = "not evaluated yet"

    def __exit__(self, *_: object) -> None:
        """Leave the screen as it is."""

    def show(self, update: "Update") -> None:
        """Take notice of an update."""
        if update.score is not None:
            self._evaluation = describe_score(update)
        self._clock.tick(update.steps)
        self._draw(update)

    def _draw(self, update: "Update") -> None:
        raise NotImplementedError


class _Clock:
    """Steps per second over the last updates. The first ones compile, so they do not count for long."""

    def __init__(self) -> None:
        self._marks: deque[tuple[float, int]] = deque(maxlen=RATE_UPDATES)
        self.rate = math.nan

    def tick(self, steps: int) -> None:
        self._marks.append((time.monotonic(), steps))
        (first_time, first_steps), (last_time, last_steps) = self._marks[0], self._marks[-1]
        if last_time > first_time:
            self.rate = (last_steps - first_steps) / (last_time - first_time)


class _Lines(Screen):
    """One line every few seconds and at the end of each stage."""

    def __enter__(self) -> "Screen":
        print(f"training {self.title}: {self.total_steps:,} steps", flush=True)
        self._last_line = -math.inf
        return self

    def _draw(self, update: "Update") -> None:
        now = time.monotonic()
        if now - self._last_line < LINE_SECONDS and not update.phase_ended:
            return
        self._last_line = now
        remaining = (self.total_steps - update.steps) / self._clock.rate
        eta = "" if math.isnan(remaining) else f"  {self._clock.rate / 1e3:.0f}k steps/s  {remaining:.0f} s left"
        share = update.steps / self.total_steps
        print(
            f"stage {update.phase.number}  {share:4.0%}  {update.steps:>11,} steps{eta}  {self._evaluation}", flush=True
        )


class _Panel(Screen):
    """A progress bar that stays in place."""

    def __enter__(self) -> "Screen":
        self._bar = Progress(
            TextColumn("{task.fields[stage]}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[evaluation]}"),
            console=self.console,
        )
        self.console.print(f"training {self.title}: {self.total_steps:,} steps")
        fields: dict[str, Any] = {"stage": "compiling", "rate": "", "evaluation": ""}
        self._task = self._bar.add_task("train", total=self.total_steps, **fields)
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def _draw(self, update: "Update") -> None:
        rate = "" if math.isnan(self._clock.rate) else f"{self._clock.rate / 1e3:.0f}k steps/s"
        stage = f"stage {update.phase.number} {update.phase.stage.name}"
        self._bar.update(self._task, completed=update.steps, stage=stage, rate=rate, evaluation=self._evaluation)
        if update.phase_ended:
            self._bar.console.print(
                f"stage {update.phase.number} done after {update.steps:,} steps: {self._evaluation}"
            )


def describe_score(update: "Update") -> str:
    """Win rate, survival, speed and lap time of the last evaluation, in one phrase."""
    score = update.score
    assert score is not None
    lap = "no lap yet" if math.isnan(score.lap_time) else f"lap {score.lap_time:.2f} s"
    wins = "" if update.phase.alone else f"win rate {score.win_rate:.0%}, "
    return f"{wins}success {score.success:.0%}, {score.speed:.2f} m/s, {lap}"


def make_screen(console: Console, config: TrainConfig, total_steps: int) -> Screen:
    """A panel for a terminal, lines for a file or a pipe."""
    kind = _Panel if console.is_terminal else _Lines
    return kind(console, config, total_steps)
