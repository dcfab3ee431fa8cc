"""Learning curves: one thin line per seed, a panel per quantity and track."""

import math
from itertools import accumulate

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.presets import CURRICULUM
from cruise.report.figure_style import Style, legend_below, tidy
from experiments.evidence import Evidence
from experiments.figures.style import COLOURS, panels
from experiments.plan import KINDS

DASHES = {"cruise": "-", "vanilla": "--", "curriculum-only": ":", "self-play-only": "-."}
SHOWN = {"success": ("survived evaluation races", 1.05), "speed": ("mean speed [m/s]", math.nan)}  # label, highest


def curves(evidence: Evidence) -> Figure:
    """Survival and speed in evaluations while learning."""
    tracks, drones = evidence.scale.tracks, max(evidence.scale.drones)
    figure, grid = panels(5.6 * len(tracks), 2.7 * len(SHOWN) + 0.5, (len(SHOWN), len(tracks)), sharex=True)
    for row, (axes_row, (name, (label, high))) in enumerate(zip(grid, SHOWN.items(), strict=True), start=1):
        for axes, track in zip(axes_row, tracks, strict=True):
            _draw(axes, evidence, name, track)
            last = "million steps" if row == len(SHOWN) else ""
            tidy(axes, f"{track}, {drones} drones", xlabel=last, ylabel=label)
            axes.set_ylim(0.0, None if math.isnan(high) else high)
    legend_below(figure, list(grid.flat), columns=4)
    return figure


def _draw(axes: Axes, evidence: Evidence, name: str, track: str) -> None:
    for kind, dashes in DASHES.items():
        style: Style = {"color": COLOURS[kind], "linestyle": dashes, "linewidth": 1.2}
        for cell in evidence.of(kind, track, max(evidence.scale.drones)):
            if cell.curve:
                steps, values = np.array(cell.curve.steps) / 1e6, np.array(getattr(cell.curve, name), float)
                known = np.isfinite(values)
                axes.plot(steps[known], values[known], label=KINDS[kind].title, alpha=0.8, **style)
    for edge in accumulate(stage.steps * evidence.scale.step_scale / 1e6 for stage in CURRICULUM[:-1]):
        axes.axvline(edge, color="#bbbbbb", linewidth=0.8, zorder=0)
