"""Charts over the gates of a race: who led, how fast, how high."""

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from cruise.evaluation.metrics import overtakes
from cruise.palette import drone_colour as colour
from cruise.racing.motion import poses
from cruise.racing.shapes import opening
from cruise.report.figure_style import FAINT, Style, tidy
from cruise.report.race_scene import START_WIDTH, Scene, crashes, flown, style
from cruise.storage.log_track import gates_of


def draw_gaps(axes: Axes, scene: Scene) -> None:
    """Time behind the first at every crossing; rings where a drone had just overtaken."""
    crossings = scene.crossings
    first = np.fmin.reduce(crossings, axis=0)
    gaps = crossings - first
    number = np.arange(1, crossings.shape[1] + 1)
    for drone in range(scene.log.num_drones):
        axes.plot(number, gaps[drone], marker="o", markersize=3.5, linewidth=1.6, **style(drone))
    for drone, crossing in sorted({(one.drone, one.crossing) for one in overtakes(scene.log)}):
        ring: Style = {"markerfacecolor": "none", "markeredgecolor": colour(drone), "markeredgewidth": 1.6}
        axes.plot(number[crossing], gaps[drone, crossing], "o", markersize=11, **ring)
    for drone, sample in crashes(scene.log):
        last = gaps[drone][np.isfinite(gaps[drone])]
        place = scene.progress[sample, drone], last[-1] if len(last) else 0.0
        axes.plot(*place, "X", markersize=10, color=colour(drone), markeredgecolor="white")
    largest = max(0.5, float(np.fmax.reduce(gaps, axis=None)) if np.isfinite(gaps).any() else 0.0)
    axes.set_ylim(1.08 * largest, -0.1 * largest)
    tidy(axes, "Behind the first at every gate (rings: just overtook; crosses: collisions)", ylabel="gap [s]")


def draw_speeds(axes: Axes, scene: Scene) -> None:
    """Speed of every drone."""
    speed = np.linalg.norm(scene.log.velocity_w, axis=2)
    _over_gates(axes, scene, speed)
    axes.set_ylim(0.0, max(1.0, 1.05 * float(speed.max())))
    tidy(axes, "Speed", ylabel="[m/s]")


def draw_heights(axes: Axes, scene: Scene) -> None:
    """Heights, and the openings of the gates as bars: all that they reach, where they move."""
    log = scene.log
    heights = [np.concatenate([opening(pose)[:, 2] for pose in poses(gate)]) for gate in gates_of(log)]
    ends = [(float(rim.min()), float(rim.max())) for rim in heights]
    for crossing in range(log.gates_to_finish):
        gate = (log.next_gate[0, 0] + crossing) % log.num_gates
        low, high = ends[gate]
        axes.plot([crossing + 1] * 2, [max(low, 0.0), high], color="#cfcfcf", linewidth=5, solid_capstyle="butt")
    _over_gates(axes, scene, log.position_w[..., 2])
    tidy(axes, "Height (bars: openings of the gates)", ylabel="z [m]")


def _over_gates(axes: Axes, scene: Scene, values: np.ndarray) -> None:
    """[T, N] values over the progress of every drone."""
    for drone in range(scene.log.num_drones):
        part = flown(scene, drone)
        axes.plot(scene.progress[part, drone], values[part, drone], linewidth=1.3, alpha=0.85, **style(drone))
    for drone, sample in crashes(scene.log):
        place = scene.progress[sample, drone], values[sample, drone]
        axes.plot(*place, "X", markersize=9, color=colour(drone), markeredgecolor="white", zorder=5)


def share_gate_axis(panels: tuple[Axes, ...], scene: Scene) -> None:
    """One axis of gate crossings for all panels, gates by number, laps as bands."""
    log = scene.log
    number = np.arange(1, log.gates_to_finish + 1)
    gates = (log.next_gate[0, 0] + number - 1) % log.num_gates + 1
    every = -(-len(number) // 40)
    laps = [1 + lap * log.num_gates for lap in range(log.laps + 1)]
    for axes in panels:
        axes.set_xlim(1 - START_WIDTH - 0.2, log.gates_to_finish + 0.3)
        axes.set_xticks(number[::every], [str(gate) for gate in gates[::every]])
        for start, end in list(pairwise(laps))[::2]:
            axes.axvspan(start, end, color="#f3f3f3", linewidth=0, zorder=-5)
        axes.tick_params(labelbottom=axes is panels[-1])
    for lap, start in enumerate(laps[:-1], start=1):
        place: Style = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "xytext": (5, 4)}
        panels[1].annotate(f"lap {lap}", (start, 0.0), fontsize=9, color=FAINT, **place)
    panels[-1].set_xlabel("gate")
