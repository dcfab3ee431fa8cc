"""Learning curves of a run."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.report.figure_style import BLUE, VERMILION, our_look, to_png
from cruise.storage.atomic import write_atomically

# (row key, title, unit); evaluations are drawn as points joined by lines, rollouts as lines
PANELS = (
    ("reward", "Reward per step", ""),
    ("speed", "Mean speed", "m/s"),
    ("evaluation/lap_time", "Lap time in evaluations", "s"),
    ("evaluation/success", "Survival and win rate in evaluations", ""),
    ("terminated", "Crashes per 1000 steps", ""),
    ("policy/std", "Standard deviation of actions", ""),
)
COLOURS = (BLUE, VERMILION)


@our_look()
def draw_training(rows: Sequence[dict[str, Any]], title: str, path: Path) -> None:
    """Write a picture of a run's metrics (`cruise.training.metrics_log.read_metrics`), stages shaded, to `path`."""
    figure = Figure(figsize=(12, 7), layout="constrained")
    figure.suptitle(title)
    for axes, (key, name, unit) in zip(figure.subplots(2, 3, sharex=True).flat, PANELS, strict=True):
        _shade_stages(axes, rows)
        _draw(axes, rows, key, scale=1000 if key == "terminated" else 1)
        axes.set_title(name, fontsize=10)
        axes.set_ylabel(unit)
        axes.grid(alpha=0.3)
    for axes in figure.axes[3:]:
        axes.set_xlabel("million steps")
    _add_win_rate(figure.axes[3], rows)
    write_atomically(path, to_png(figure))


def _series(rows: Sequence[dict[str, Any]], key: str) -> tuple[np.ndarray, np.ndarray]:
    points = [(row["steps"] / 1e6, row[key]) for row in rows if key in row]
    return np.array([p[0] for p in points]), np.array([p[1] for p in points])


def _draw(axes: Axes, rows: Sequence[dict[str, Any]], key: str, scale: float) -> None:
    steps, values = _series(rows, key)
    measured = key.startswith("evaluation/")
    style: dict[str, Any] = {"marker": ".", "label": "survival"} if measured else {}
    axes.plot(steps, values * scale, color=COLOURS[0], linewidth=1, **style)


def _add_win_rate(axes: Axes, rows: Sequence[dict[str, Any]]) -> None:
    steps, values = _series(rows, "evaluation/win_rate")
    axes.plot(steps, values, color=COLOURS[1], linewidth=1, marker=".", label="win rate")
    axes.set_ylim(-0.02, 1.02)
    axes.legend(fontsize=8)


def _shade_stages(axes: Axes, rows: Sequence[dict[str, Any]]) -> None:
    stages = sorted({row["stage"] for row in rows})
    for stage in stages:
        steps = [row["steps"] / 1e6 for row in rows if row["stage"] == stage]
        axes.axvspan(steps[0], steps[-1], color="black", alpha=0.03 if stage % 2 else 0.09, linewidth=0)
