"""Who beats whom: a matrix of rates with their intervals, in shades of one colour."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from cruise.report.figure_style import BLUE, INK, new_figure, our_look

SHADES = LinearSegmentedColormap.from_list("rates", ["white", "#cfe3f1", BLUE])


@dataclass(frozen=True)
class Matrix:
    """`rates[i][j]`: (mean, low, high) share that row i wins against column j, None where they do not meet."""

    title: str
    names: tuple[str, ...]
    rates: tuple[tuple[tuple[float, float, float] | None, ...], ...]


@our_look()
def draw_matrices(matrices: Sequence[Matrix]) -> Figure:
    """Matrices side by side."""
    figure = new_figure(6.6 * len(matrices), 4.2)
    for axes, matrix in zip(figure.subplots(1, len(matrices), squeeze=False)[0], matrices, strict=True):
        _draw(axes, matrix)
    return figure


def _draw(axes: Axes, matrix: Matrix) -> None:
    size = len(matrix.names)
    shades = [[rate[0] if rate else math.nan for rate in row] for row in matrix.rates]
    axes.pcolormesh(shades, cmap=SHADES, vmin=0.0, vmax=1.0, edgecolors="white", linewidth=2)
    for i, row in enumerate(matrix.rates):
        for j, rate in enumerate(row):
            if rate is not None:
                _write(axes, i, j, rate)
    ticks = [i + 0.5 for i in range(size)]
    axes.set_xticks(ticks, ["against\n" + name.replace(", ", ",\n") for name in matrix.names], fontsize=8)
    axes.set_yticks(ticks, matrix.names, fontsize=9)
    axes.set_xlim(0, size)
    axes.set_ylim(size, 0)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_title(matrix.title, loc="left", fontsize=11, color=INK)


def _write(axes: Axes, i: int, j: int, rate: tuple[float, float, float]) -> None:
    mean, low, high = rate
    if math.isnan(mean):
        axes.text(j + 0.5, i + 0.5, "not run", ha="center", va="center", fontsize=8, color=INK)
        return
    ink = "white" if mean > 0.62 else INK
    axes.text(j + 0.5, i + 0.45, f"{100 * mean:.0f} %", ha="center", va="center", fontsize=13, color=ink)
    if not math.isnan(low):
        between = f"{100 * low:.0f} to {100 * high:.0f}"
        axes.text(j + 0.5, i + 0.75, between, ha="center", va="center", fontsize=8, color=ink)
