"""CRUISE's speed after every stage of training, the track in a corner, as in the paper's ablation figures."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.config import Track
from cruise.palette import BLACK, FAINT, INK
from cruise.presets import CURRICULUM, PAPER_TRACKS
from cruise.report.figure_style import Style, legend_below, tidy
from experiments.evidence import Evidence
from experiments.figures.style import DRONE_COLOURS, MARKERS, panels
from experiments.printed import STAGE_SPEEDS

CEILING = 5.0  # the top of the scale, at least [m/s]


def stages(evidence: Evidence) -> Figure:
    """Error bars for intervals, dashed lines with hollow marks for the paper's files."""
    tracks = evidence.scale.tracks
    figure, grid = panels(6.6 * len(tracks), 4.6, (1, len(tracks)))
    for axes, track in zip(grid[0], tracks, strict=True):
        for number, drones in enumerate(evidence.scale.drones):
            look: Style = {"marker": MARKERS[number], "color": DRONE_COLOURS.get(drones, BLACK)}
            _draw_measured(axes, evidence, (track, drones), _shift(evidence, number), look)
        for number, drones in enumerate(evidence.scale.drones):
            look = {"marker": MARKERS[number], "color": DRONE_COLOURS.get(drones, BLACK)}
            _draw_printed(axes, (track, drones), _shift(evidence, number), look)
        _finish(axes, track)
    legend_below(figure, list(grid[0]), columns=6)
    return figure


def _shift(evidence: Evidence, number: int) -> float:
    """Keeps series beside each other."""
    return 0.07 * (number - (len(evidence.scale.drones) - 1) / 2)


def _draw_measured(axes: Axes, evidence: Evidence, place: tuple[str, int], shift: float, look: Style) -> None:
    found = {stage: summary.air_speed for stage, summary in evidence.stages("cruise", *place).items()}
    points = [(stage, s.mean, s.low, s.high) for stage, s in found.items() if s.known]
    if points:
        stage, mean, low, high = np.array(points).T
        bars = np.nan_to_num(np.stack([mean - low, high - mean]))
        look = look | {"linewidth": 1.8, "capsize": 4, "markersize": 6, "label": f"{place[1]} drones"}
        axes.errorbar(stage + shift, mean, yerr=bars, **look)


def _draw_printed(axes: Axes, place: tuple[str, int], shift: float, look: Style) -> None:
    printed = STAGE_SPEEDS[place]
    look = look | {"linestyle": "--", "linewidth": 1.0, "alpha": 0.7, "label": f"{place[1]} drones, paper"}
    axes.plot(np.arange(1, len(printed) + 1) + shift, printed, markerfacecolor="white", **look)


def _finish(axes: Axes, track: str) -> None:
    tidy(axes, f"{track}: mean speed in the air", xlabel="after stage", ylabel="m/s")
    names = [f"{i}\n{stage.name}" for i, stage in enumerate(CURRICULUM, start=1)]
    axes.set_xticks(range(1, len(names) + 1), names, fontsize=8)
    axes.set_ylim(0.0, max(CEILING, axes.get_ylim()[1]))
    _inset(axes, PAPER_TRACKS[track])


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
