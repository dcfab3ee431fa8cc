"""Who beats whom: a matrix of rates with their intervals per track, in shades of one colour."""

import math

from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from cruise.palette import BLUE, INK
from experiments.evidence import Evidence
from experiments.figures.style import panels
from experiments.plan import DUEL, ENTRANTS, KINDS
from experiments.pooling import NOTHING, Pooled
from experiments.ratings import win_rate

SHADES = LinearSegmentedColormap.from_list("rates", ["white", "#cfe3f1", BLUE])


def duels(evidence: Evidence) -> Figure:
    """The win-rate matrices."""
    tracks = evidence.scale.tracks
    figure, grid = panels(6.6 * len(tracks), 4.2, (1, len(tracks)))
    for axes, track in zip(grid[0], tracks, strict=True):
        met = evidence.met(track, DUEL)
        rates = [[NOTHING if a == b else win_rate(met, a, b) for b in ENTRANTS] for a in ENTRANTS]
        axes.pcolormesh(
            [[rate.mean for rate in row] for row in rates],
            cmap=SHADES,
            vmin=0.0,
            vmax=1.0,
            edgecolors="white",
            linewidth=2,
        )
        for i, row in enumerate(rates):
            for j, rate in enumerate(row):
                if i != j:
                    _write(axes, i, j, rate)
        _finish(axes, f"{track}: the pilot of the row wins")
    return figure


def _finish(axes: Axes, title: str) -> None:
    names = [KINDS[kind].title for kind in ENTRANTS]
    ticks = [i + 0.5 for i in range(len(names))]
    axes.set_xticks(ticks, ["against\n" + name.replace(", ", ",\n") for name in names], fontsize=8)
    axes.set_yticks(ticks, names, fontsize=9)
    axes.set_xlim(0, len(names))
    axes.set_ylim(len(names), 0)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_title(title, loc="left", fontsize=11, color=INK)


def _write(axes: Axes, i: int, j: int, rate: Pooled) -> None:
    if not rate.known:
        axes.text(j + 0.5, i + 0.5, "not run", ha="center", va="center", fontsize=8, color=INK)
        return
    ink = "white" if rate.mean > 0.62 else INK
    axes.text(j + 0.5, i + 0.45, f"{100 * rate.mean:.0f} %", ha="center", va="center", fontsize=13, color=ink)
    if not math.isnan(rate.low):
        between = f"{100 * rate.low:.0f} to {100 * rate.high:.0f}"
        axes.text(j + 0.5, i + 0.75, between, ha="center", va="center", fontsize=8, color=ink)
