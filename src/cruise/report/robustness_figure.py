"""Success and lap time against each thing that may differ: one panel per thing."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.report.figure_style import BLUE, FAINT, ORANGE, legend_below, new_figure, our_look, tidy

if TYPE_CHECKING:
    from cruise.evaluation.robustness import Point

COLUMNS = 4
FULL = "#f2f2f2"  # the band within the full randomisation


@our_look()
def draw_robustness(points: "Sequence[Point]", title: str) -> Figure:
    """A panel per kind, success on the left axis and the flying lap on the right; shaded is the full randomisation."""
    nominal, *others = points
    kinds = list(dict.fromkeys(point.cell.kind for point in others))
    rows = math.ceil(len(kinds) / COLUMNS)
    figure = new_figure(4.0 * COLUMNS, 2.7 * rows + 0.8)
    figure.suptitle(f"{title}; shaded: the full randomisation", x=0.01, ha="left", fontsize=12)
    grid = list(figure.subplots(rows, COLUMNS, squeeze=False).flat)
    laps = [p.flying_lap_time.mean for p in points if not math.isnan(p.flying_lap_time.mean)]
    panels = []
    for axes, kind in zip(grid, kinds, strict=False):
        mine = sorted((nominal, *(p for p in others if p.cell.kind == kind)), key=lambda p: p.cell.strength)
        panels += _draw(axes, mine, f"{kind.name} [{kind.unit}]", (min(laps), max(laps)) if laps else None)
    for axes in grid[len(kinds) :]:
        axes.set_axis_off()
    legend_below(figure, panels)
    return figure


def _draw(axes: Axes, points: "Sequence[Point]", title: str, laps: tuple[float, float] | None) -> list[Axes]:
    kind = points[-1].cell.kind
    x = [point.cell.value if point.cell.kind == kind else 0.0 for point in points]
    full = next(point.cell.value for point in points if point.cell.kind == kind and point.cell.strength == 1)
    axes.axvspan(-full if kind.signed else 0.0, full, color=FULL, zorder=0)
    success = [point.success_rate for point in points]
    mean = [100 * rate.mean for rate in success]
    bars = [[100 * (rate.mean - rate.low) for rate in success], [100 * (rate.high - rate.mean) for rate in success]]
    axes.errorbar(x, mean, yerr=bars, color=BLUE, marker="o", markersize=4, capsize=2, label="finished [%]")
    axes.set_ylim(0, 104)
    tidy(axes, title)
    right = axes.twinx()
    right.plot(
        x, [p.flying_lap_time.mean for p in points], color=ORANGE, marker="s", markersize=4, label="flying lap [s]"
    )
    if laps is not None:
        margin = 0.1 * (laps[1] - laps[0]) + 0.01
        right.set_ylim(laps[0] - margin, laps[1] + margin)
    right.spines[["top"]].set_visible(False)
    right.spines[["right"]].set_color(FAINT)
    return [axes, right]
