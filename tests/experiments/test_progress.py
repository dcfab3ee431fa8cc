"""What a person sees of a study."""

import io

import pytest
from rich.console import Console

from experiments.plan import Job
from experiments.progress import show_events
from experiments.study import Event
from experiments.work import Step

JOBS = [Job("cruise", "ring", 2, 0), Job("cruise", "ring", 3, 0), Job("se-ibr", "ring", 2, 0)]
EVENTS = [
    Event(JOBS[0], "started"),
    Event(JOBS[0], "step", Step("training", 1, 4)),
    Event(JOBS[0], "step", Step("measuring")),
    Event(JOBS[0], "done", seconds=600.0),
    Event(JOBS[1], "started"),
    Event(JOBS[1], "busy", message="another process is running it"),
    Event(JOBS[2], "started"),
    Event(JOBS[2], "failed", message="no [bold]such[/bold] pilot"),
]


@pytest.mark.parametrize("terminal", [False, True])
def test_outcomes_are_told(terminal):
    file = io.StringIO()
    console = Console(file=file, force_terminal=terminal, color_system=None, width=140)
    assert show_events(console, iter(EVENTS), JOBS, 10) == 1
    text = file.getvalue()
    assert "7 of 10 done before, 3 to run" in text
    assert "ring-2-cruise-s0: done in 600 s" in text
    assert "ring-3-cruise-s0: busy: another process is running it" in text
    assert "ring-2-se-ibr-s0: failed: no [bold]such[/bold] pilot" in text
    assert "1 failed: ring-2-se-ibr-s0; the same command tries again" in text
    assert "1 of 3, about 20 min left" in text  # two more as long as the first
    assert "3 of 3" in text


def test_nothing_failed(capsys):
    assert show_events(Console(), iter(EVENTS[:4]), JOBS[:1], 1) == 0
    assert "failed" not in capsys.readouterr().out
