"""A quantity after every stage of training, the track in a corner."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.config import Track
from cruise.report.figure_style import FAINT, INK, MARKERS, Style, legend_below, new_figure, our_look, tidy


@dataclass(frozen=True)
class StageLine:
    """One series: (stage, mean, low, high) in order of stages."""

    label: str
    colour: str
    points: tuple[tuple[int, float, float, float], ...]
    printed: tuple[float, ...] = ()  # of stages 1, 2 ...


@dataclass(frozen=True)
class StagePanel:
    """One track."""

    track: Track
    title: str
    unit: str
    lines: tuple[StageLine, ...]
    ceiling: float  # the top of the scale, at least


@our_look()
def draw_stages(panels: Sequence[StagePanel], stages: Sequence[str]) -> Figure:
    """Panels side by side, error bars for intervals, dashed lines with hollow marks for what others printed."""
    figure = new_figure(6.6 * len(panels), 4.6)
    row = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, panel in zip(row, panels, strict=True):
        _draw(axes, panel, stages)
    legend_below(figure, list(row), columns=6)
    return figure


def _draw(axes: Axes, panel: StagePanel, stages: Sequence[str]) -> None:
    for number, line in enumerate(panel.lines):
        shift, marker = _shift(number, len(panel.lines)), MARKERS[number % len(MARKERS)]
        known = [p for p in line.points if not math.isnan(p[1])]
        if known:
            stage, mean, low, high = np.array(known).T
            bars = np.nan_to_num(np.stack([mean - low, high - mean]))
            style: Style = {"marker": marker, "color": line.colour, "linewidth": 1.8, "capsize": 4, "markersize": 6}
            axes.errorbar(stage + shift, mean, yerr=bars, label=line.label, **style)
    for number, line in enumerate(panel.lines):
        if line.printed:
            shift, marker = _shift(number, len(panel.lines)), MARKERS[number % len(MARKERS)]
            look: Style = {"marker": marker, "color": line.colour, "linestyle": "--", "linewidth": 1.0, "alpha": 0.7}
            x = np.arange(1, len(line.printed) + 1) + shift
            axes.plot(x, line.printed, markerfacecolor="white", label=f"{line.label}, paper", **look)
    tidy(axes, panel.title, xlabel="after stage", ylabel=panel.unit)
    axes.set_xticks(range(1, len(stages) + 1), [f"{i}\n{name}" for i, name in enumerate(stages, start=1)], fontsize=8)
    axes.set_ylim(0.0, max(panel.ceiling, axes.get_ylim()[1]))
    _inset(axes, panel.track)


def _shift(number: int, count: int) -> float:
    """Keeps series beside each other."""
    return 0.07 * (number - (count - 1) / 2)


def _inset(axes: Axes, track: Track) -> None:
    """The track from above: gates as bars, the polygon that joins them."""
    inset = axes.inset_axes((0.68, 0.04, 0.31, 0.34))
    corners = np.array([gate.position_w[:2] for gate in track.gates])
    inset.plot(*np.vstack([corners, corners[:1]]).T, color=FAINT, linewidth=0.9, linestyle=":")
    for gate, centre in zip(track.gates, corners, strict=True):
        side = np.array([-np.sin(gate.yaw), np.cos(gate.yaw)]) * gate.width / 2
        inset.plot(*np.stack([centre - side, centre + side]).T, color=INK, linewidth=2.2)
    inset.set_aspect("equal")
    inset.margins(0.12)
    inset.set_xticks([])
    inset.set_yticks([])
    inset.patch.set_alpha(0.85)
    inset.spines[:].set_color("#cccccc")
