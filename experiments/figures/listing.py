"""Named rows of one value each, with intervals: easier to read than a legend where there is one group alone."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.report.figure_style import FAINT, INK, Style, new_figure, our_look, tidy
from experiments.figures.comparison import Dot


@dataclass(frozen=True)
class Listing:
    """One quantity. Rows are (name, colour, dot), None where there is nothing."""

    title: str
    unit: str
    rows: tuple[tuple[str, str, Dot | None], ...]
    lines: tuple[tuple[float, str], ...] = ()  # (value, what it is)


@our_look()
def draw_listings(panels: Sequence[Sequence[Listing]]) -> Figure:
    """Panels in rows and columns; names stand at the left of each row of panels."""
    names = max(len(panel.rows) for row in panels for panel in row)
    figure = new_figure(5.6 * len(panels[0]), (0.36 * names + 0.9) * len(panels))
    grid = figure.subplots(len(panels), len(panels[0]), squeeze=False, sharey="row")
    for axes_row, row in zip(grid, panels, strict=True):
        for axes, panel in zip(axes_row, row, strict=True):
            _draw(axes, panel)
        axes_row[0].set_ylim(len(row[0].rows) - 0.5, -0.5)
    return figure


def _draw(axes: Axes, panel: Listing) -> None:
    for height, (_, colour, dot) in enumerate(panel.rows):
        if dot is None or math.isnan(dot.mean):
            look: Style = {"xycoords": ("axes fraction", "data"), "fontsize": 8, "color": FAINT, "va": "center"}
            axes.annotate("nothing measured", (0.01, height), **look)
            continue
        if not math.isnan(dot.low):
            axes.plot([dot.low, dot.high], [height, height], color=colour, linewidth=2.5, alpha=0.55)
        axes.plot(dot.mean, height, "o", markersize=7, color=colour)
    for value, what in panel.lines:
        axes.axvline(value, color=INK, linewidth=1.0, linestyle=":", zorder=1)
        place = (value, 0.01)
        axes.annotate(what, place, xycoords=("data", "axes fraction"), ha="left", va="bottom", fontsize=8, color=INK)
    tidy(axes, panel.title, xlabel=panel.unit)
    axes.set_yticks(range(len(panel.rows)), [name for name, _, _ in panel.rows], fontsize=9)
