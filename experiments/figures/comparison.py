"""Pilots side by side: dots with intervals, a panel per quantity and track, and printed figures as hollow marks."""

import math
from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.palette import FAINT, GRID, INK
from cruise.report.figure_style import Style, legend_below, tidy
from experiments.evidence import Evidence
from experiments.figures.style import COLOURS, LAP, MARKERS, SPEED, SUCCESS, Quantity, panels
from experiments.plan import ENTRANTS, KINDS
from experiments.pooling import Pooled
from experiments.printed import FREE, GENTLE, Limit

SHOWN = (*ENTRANTS, "self-play-only")
WIDTH = 0.72  # of a group that its kinds fill
HIGHEST = 105.0  # of a scale in percent, which begins just below 0


def overview(evidence: Evidence) -> Figure:
    """Success, speed and lap of all pilots."""
    return _draw(evidence, (SUCCESS, SPEED, LAP), SHOWN, {"limit": FREE})


def limits(evidence: Evidence) -> Figure:
    """Timed laps against what the vehicle can do."""
    return _draw(evidence, (LAP,), ENTRANTS, {"free": FREE, "gentle": GENTLE})


def _draw(
    evidence: Evidence, quantities: Sequence[Quantity], kinds: Sequence[str], lines: Mapping[str, Limit]
) -> Figure:
    tracks = evidence.scale.tracks
    size = 5.4 * len(tracks), 2.9 * len(quantities) + 0.6
    figure, grid = panels(*size, (len(quantities), len(tracks)))
    for axes_row, quantity in zip(grid, quantities, strict=True):
        for axes, track in zip(axes_row, tracks, strict=True):
            _draw_kinds(axes, evidence, kinds, quantity, track)
            if quantity is LAP:
                _draw_lines(axes, {what: limit.lap(track) for what, limit in lines.items()})
            _finish(axes, evidence.scale.drones, quantity, track)
    if quantities != (LAP,):
        grid.flat[-1].plot([], [], "o", markerfacecolor="white", markeredgecolor=FAINT, label="hollow: printed")
    legend_below(figure, list(grid.flat), columns=6)
    return figure


def _draw_kinds(axes: Axes, evidence: Evidence, kinds: Sequence[str], quantity: Quantity, track: str) -> None:
    for number, kind in enumerate(kinds):
        look: Style = {"marker": MARKERS[number], "color": COLOURS[kind], "linestyle": ""}
        offset = WIDTH * ((number + 0.5) / len(kinds) - 0.5)
        for group, drones in enumerate(evidence.scale.drones):
            _draw_printed(axes, group + offset, quantity.printed(kind, track, drones), look)
            _draw_dot(
                axes, group + offset, quantity.of(evidence, kind, track, drones), look | {"label": KINDS[kind].title}
            )


def _draw_printed(axes: Axes, x: float, value: float | None, look: Style) -> None:
    if value is not None:
        hollow: Style = {"markerfacecolor": "white", "markeredgecolor": look["color"], "markeredgewidth": 1.4}
        axes.plot(x - 0.045, value, look["marker"], markersize=6, zorder=3, linestyle="", alpha=0.9, **hollow)


def _draw_dot(axes: Axes, x: float, pooled: Pooled | None, look: Style) -> None:
    if pooled is None:
        return
    if not math.isnan(pooled.low):
        axes.plot([x, x], [pooled.low, pooled.high], color=look["color"], linewidth=2.0, alpha=0.55, zorder=4)
    axes.plot(x, pooled.mean, markersize=6.5, zorder=5, **look)


def _draw_lines(axes: Axes, lines: Mapping[str, float]) -> None:
    for what, value in lines.items():
        axes.axhline(value, color=INK, linewidth=1.0, linestyle=":", zorder=1)
        axes.annotate(what, (1.01, value), xycoords=("axes fraction", "data"), ha="left", va="center", fontsize=8)


def _finish(axes: Axes, drones: Sequence[int], quantity: Quantity, track: str) -> None:
    if quantity is SUCCESS:
        axes.set_ylim(-0.04 * HIGHEST, HIGHEST)
    for edge in range(1, len(drones)):
        axes.axvline(edge - 0.5, color=GRID, linewidth=0.8)
    tidy(axes, f"{track}: {quantity.title}", ylabel=quantity.label)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.5, len(drones) - 0.5)
    axes.set_xticks(range(len(drones)), [f"{n} drones" for n in drones])
