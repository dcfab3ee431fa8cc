"""Methods side by side: dots with intervals, one panel per quantity, and what others printed as hollow marks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.report.figure_style import FAINT, GRID, INK, MARKERS, Style, legend_below, new_figure, our_look, tidy

WIDTH = 0.72  # of a group that its series fill


@dataclass(frozen=True)
class Dot:
    """A value with its interval; `printed` is what it is held against."""

    mean: float
    low: float = math.nan
    high: float = math.nan
    printed: float | None = None


@dataclass(frozen=True)
class Series:
    """One method: a dot per group, None where there is none."""

    label: str
    colour: str
    dots: tuple[Dot | None, ...]


@dataclass(frozen=True)
class Panel:
    """One quantity."""

    title: str
    unit: str
    groups: tuple[str, ...]
    series: tuple[Series, ...]
    lines: tuple[tuple[float, str], ...] = ()  # (value, what it is)
    high: float | None = None  # the scale goes from just below 0 to here


@our_look()
def draw_comparison(rows: Sequence[Sequence[Panel]]) -> Figure:
    """Panels in rows and columns, one legend."""
    figure = new_figure(5.4 * len(rows[0]), 2.9 * len(rows) + 0.6)
    grid = figure.subplots(len(rows), len(rows[0]), squeeze=False)
    for axes_row, row in zip(grid, rows, strict=True):
        for axes, panel in zip(axes_row, row, strict=True):
            _draw(axes, panel)
    if any(dot and dot.printed is not None for row in rows for p in row for s in p.series for dot in s.dots):
        grid.flat[-1].plot([], [], "o", markerfacecolor="white", markeredgecolor=FAINT, label="hollow: printed")
    legend_below(figure, list(grid.flat), columns=6)
    return figure


def _draw(axes: Axes, panel: Panel) -> None:
    offsets = _offsets(len(panel.series))
    for number, (series, offset) in enumerate(zip(panel.series, offsets, strict=True)):
        marker = MARKERS[number % len(MARKERS)]
        for group, dot in enumerate(series.dots):
            if dot is not None:
                _draw_dot(axes, group + offset, dot, series, marker)
    for value, what in panel.lines:
        axes.axhline(value, color=INK, linewidth=1.0, linestyle=":", zorder=1)
        axes.annotate(what, (1.01, value), xycoords=("axes fraction", "data"), ha="left", va="center", fontsize=8)
    if panel.high is not None:
        axes.set_ylim(-0.04 * panel.high, panel.high)
    for edge in range(1, len(panel.groups)):
        axes.axvline(edge - 0.5, color=GRID, linewidth=0.8)
    tidy(axes, panel.title, ylabel=panel.unit)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.5, len(panel.groups) - 0.5)
    axes.set_xticks(range(len(panel.groups)), panel.groups)


def _draw_dot(axes: Axes, x: float, dot: Dot, series: Series, marker: str) -> None:
    hollow: Style = {"markerfacecolor": "white", "markeredgecolor": series.colour, "markeredgewidth": 1.4, "alpha": 0.9}
    if dot.printed is not None:
        axes.plot(x - 0.045, dot.printed, marker, markersize=6, zorder=3, linestyle="", **hollow)
    if math.isnan(dot.mean):
        return
    if not math.isnan(dot.low):
        axes.plot([x, x], [dot.low, dot.high], color=series.colour, linewidth=2.0, alpha=0.55, zorder=4)
    axes.plot(x, dot.mean, marker, markersize=6.5, color=series.colour, label=series.label, linestyle="", zorder=5)


def _offsets(count: int) -> list[float]:
    return [WIDTH * ((i + 0.5) / count - 0.5) for i in range(count)]
