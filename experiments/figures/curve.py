"""Learning curves: one thin line per seed, one panel per quantity and place."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.report.figure_style import Style, legend_below, new_figure, our_look, tidy

DASHES = ("-", "--", ":", "-.")


@dataclass(frozen=True)
class CurveLine:
    """One seed of one method. NaN where nothing was measured."""

    label: str
    colour: str
    dashes: int  # index into DASHES
    steps: tuple[float, ...]  # millions
    values: tuple[float, ...]


@dataclass(frozen=True)
class CurvePanel:
    """One quantity."""

    title: str
    unit: str
    lines: tuple[CurveLine, ...]
    edges: tuple[float, ...] = ()  # ends of stages [million steps]
    high: float = math.nan  # of the scale, where it is fixed


@our_look()
def draw_curves(rows: Sequence[Sequence[CurvePanel]]) -> Figure:
    """Panels in rows and columns, one legend."""
    figure = new_figure(5.6 * len(rows[0]), 2.7 * len(rows) + 0.5)
    grid = figure.subplots(len(rows), len(rows[0]), squeeze=False, sharex=True)
    for axes_row, row in zip(grid, rows, strict=True):
        for axes, panel in zip(axes_row, row, strict=True):
            _draw(axes, panel, last=row is rows[-1])
    legend_below(figure, list(grid.flat), columns=4)
    return figure


def _draw(axes: Axes, panel: CurvePanel, last: bool) -> None:
    for line in panel.lines:
        steps, values = np.array(line.steps, float), np.array(line.values, float)
        known = np.isfinite(values)
        style: Style = {"color": line.colour, "linestyle": DASHES[line.dashes % len(DASHES)], "linewidth": 1.2}
        axes.plot(steps[known], values[known], label=line.label, alpha=0.8, **style)
    for edge in panel.edges:
        axes.axvline(edge, color="#bbbbbb", linewidth=0.8, zorder=0)
    tidy(axes, panel.title, xlabel="million steps" if last else "", ylabel=panel.unit)
    axes.set_ylim(0.0, None if math.isnan(panel.high) else panel.high)
