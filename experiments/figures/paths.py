"""Where the drones of one race flew: from above, and in three dimensions."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D

from cruise.report.figure_style import INK, Style, legend_below, new_figure, tidy
from cruise.report.race_scene import crashes, style
from cruise.storage.race_log import RaceLog
from experiments.evidence import Evidence
from experiments.plan import KINDS, MIXED


def paths(evidence: Evidence) -> dict[str, Figure]:
    """Trajectories of four CRUISE drones on each track, and of a mixed field; those that were kept."""
    figures = {}
    for kind, what in (("cruise", "four CRUISE drones"), ("head-to-head", "one pilot of each kind")):
        for track in evidence.scale.tracks:
            log = evidence.races.get((kind, track, MIXED))
            if log is not None:
                figures[f"paths-{kind}-{track}"] = draw_paths(log, f"{track}: {what}", _names(log, kind))
    return figures


def _names(log: RaceLog, kind: str) -> list[str]:
    """Drones of one pilot by number, others by their pilot."""
    if kind == "cruise":
        return [f"drone {drone + 1}" for drone in range(log.num_drones)]
    return [KINDS[pilot].title if pilot in KINDS else pilot for pilot in log.pilots.tolist()]


def draw_paths(log: RaceLog, title: str, names: Sequence[str]) -> Figure:
    """Paths and gates of a race, one colour per drone; rings where they started, crosses where one collided."""
    figure = new_figure(12.0, 5.4)
    grid = figure.add_gridspec(1, 2)
    above, space = figure.add_subplot(grid[0]), figure.add_subplot(grid[1], projection="3d")
    _from_above(above, log, names)
    _in_space(space, log)
    tidy(above, title, "x [m]", "y [m]")
    above.set_aspect("equal", adjustable="datalim")
    legend_below(figure, [above], columns=log.num_drones)
    return figure


def _flown(log: RaceLog, drone: int) -> np.ndarray:
    """[T', 3] while in the air."""
    return log.position_w[: int(log.airborne[:, drone].sum()) + 1, drone]


def _from_above(axes: Axes, log: RaceLog, names: Sequence[str]) -> None:
    for drone, label in enumerate(names):
        path = _flown(log, drone)
        axes.plot(path[:, 0], path[:, 1], linewidth=1.2, alpha=0.8, label=label, **style(drone))
        axes.plot(*path[0, :2], "o", markersize=6, markerfacecolor="white", markeredgecolor=style(drone)["color"])
    for drone, sample in crashes(log):
        look: Style = {"markersize": 10, "color": style(drone)["color"], "markeredgecolor": "white", "zorder": 6}
        axes.plot(*log.position_w[sample, drone, :2], "X", **look)
    for corners in gate_corners(log):
        axes.plot(*corners[:2, :2].T, color=INK, linewidth=3.5, solid_capstyle="butt")


def _in_space(axes: Axes3D, log: RaceLog) -> None:
    for drone in range(log.num_drones):
        axes.plot(*_flown(log, drone).T, linewidth=1.0, alpha=0.8, **style(drone))
    frames = [np.vstack([corners, corners[:1]]) for corners in gate_corners(log)]
    axes.add_collection3d(Line3DCollection(frames, colors=INK, linewidths=2.0))
    points = np.concatenate([*frames, *(_flown(log, drone) for drone in range(log.num_drones))])
    spans = np.ptp(points, axis=0)
    axes.set_box_aspect((spans[0], spans[1], max(2.2 * spans[2], 0.2 * spans[0])), zoom=1.15)
    axes.set_zlim(0.0, points[:, 2].max() + 0.3)
    axes.view_init(elev=32, azim=-58)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_zlabel("z [m]")


def gate_corners(log: RaceLog) -> np.ndarray:
    """[G, 4, 3] corners of the openings, the lower two first [m]."""
    side = np.stack([-np.sin(log.gate_yaw), np.cos(log.gate_yaw), np.zeros(log.num_gates)], axis=1)
    half_width, half_height = log.gate_size[:, :1] / 2 * side, log.gate_size[:, 1:] / 2 * np.array([[0.0, 0.0, 1.0]])
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return np.stack([log.gate_position + a * half_width + b * half_height for a, b in signs], axis=1)
