"""A track as a picture: seen from above, and the heights of gates and solids along a lap."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from cruise.config import Gate, Track
from cruise.palette import FAINT, GATE, SOLID
from cruise.racing.motion import poses
from cruise.racing.shapes import footprint, opening
from cruise.racing.solids import Outline, outlines
from cruise.racing.start_room import start_places
from cruise.racing.track_geometry import lap_length
from cruise.racing.ways import hermite, normal_of
from cruise.report.figure_style import BLUE, INK, new_figure, our_look, tidy, to_png

SHOWN_DRONES = 4  # of a start line
SAMPLES = 100  # of the line from gate to gate
PULL = np.array([1.3])  # of its ends along the normals, over the straight distance
BESIDE = 0.04  # of the longer side of the track: between a gate and its number


@our_look()
def draw_track(track: Track) -> bytes:
    """A PNG picture of gates, solids, start and box, with a smooth line through all gates."""
    figure = new_figure(10.5, 9.5)
    above, heights = figure.subplots(2, 1, height_ratios=(3.6, 1.0))
    way = _smooth_line(track)
    above.plot(*way[:, :2].T, color=FAINT, linewidth=1.5, zorder=1)
    _start(above, track)
    solids = tuple(outlines(track.obstacles))
    track_from_above(above, track.gates, solids)
    tidy(above, "Seen from above (thin line: a smooth one through all gates)", "x [m]", "y [m]")
    above.set_aspect("equal", adjustable="datalim")
    above.margins(0.06)
    _heights(heights, track, way)
    laps = "1 lap" if track.laps == 1 else f"{track.laps} laps"
    title = f"{track.name}: {len(track.gates)} gates, {lap_length(track.gates):.1f} m a lap, {laps}"
    figure.suptitle(title, fontsize=14, fontweight="bold", color=INK)
    return to_png(figure)


def _smooth_line(track: Track) -> np.ndarray:
    """[G P, 3] from gate to gate along their normals, whatever stands in the way."""
    pairs = zip(track.gates, track.gates[1:] + track.gates[:1], strict=True)
    return np.concatenate([hermite(a, b, PULL, SAMPLES).point_w[0] for a, b in pairs])


def track_from_above(axes: Axes, gates: Sequence[Gate], solids: Sequence[Outline]) -> None:
    """Poles and walls; openings as they are seen from above, as bars where they stand upright; gates' numbers.

    Gates that move are drawn at rest and, faintly, as far as they get.
    """
    for solid in solids:
        axes.fill(*footprint(solid).T, facecolor=SOLID, edgecolor=GATE, linewidth=0.6, zorder=3)
    centres = np.array([gate.position_w[:2] for gate in gates])
    middle, size = centres.mean(axis=0), float(np.ptp(centres, axis=0).max(initial=1.0))
    for number, gate in enumerate(gates, start=1):
        centre, forward = np.array(gate.position_w[:2]), normal_of(gate)[:2]
        rim, *others = (opening(pose)[:, :2] for pose in poses(gate))
        for other in others:
            axes.fill(*other.T, facecolor="none", edgecolor=FAINT, linewidth=3, zorder=2)
        axes.fill(*rim.T, facecolor="none", edgecolor=GATE, linewidth=4 if gate.pitch == 0 else 2, zorder=4)
        arrow = {"arrowstyle": "-|>", "color": GATE, "linewidth": 1.2}
        tip, foot = (tuple((centre + share * gate.width / 2 * forward).tolist()) for share in (1.1, 0.1))
        axes.annotate("", tip, foot, arrowprops=arrow, zorder=4)
        side = np.array([-np.sin(gate.yaw), np.cos(gate.yaw)])
        outward = side if side @ (centre - middle) >= 0 else -side
        place = centre + outward * (
            float(np.abs((np.concatenate([rim, *others]) - centre) @ side).max()) + BESIDE * size
        )
        axes.text(place[0], place[1], str(number), ha="center", va="center", fontsize=12, fontweight="bold", color=GATE)
        axes.update_datalim([place])


def _start(axes: Axes, track: Track) -> None:
    """Where drones wait, where the track says so."""
    for (x, y, _), yaw in start_places(track, SHOWN_DRONES):
        axes.plot(x, y, "o", color=BLUE, markersize=6, zorder=5)
        tip = (x + 0.4 * np.cos(yaw), y + 0.4 * np.sin(yaw))
        axes.annotate("", tip, (x, y), arrowprops={"arrowstyle": "-", "color": BLUE}, zorder=5)


def _heights(axes: Axes, track: Track, way: np.ndarray) -> None:
    """The line and the openings over the distance flown."""
    flown = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    axes.plot(flown, way[:, 2], color=FAINT, linewidth=1.5)
    for number, (gate, x) in enumerate(zip(track.gates, flown[::SAMPLES], strict=True), start=1):
        rim, *others = (opening(pose)[:, 2] for pose in poses(gate))
        for heights, colour in (*((other, FAINT) for other in others), (rim, GATE)):
            axes.plot([x, x], [heights.min(), heights.max()], color=colour, linewidth=4, solid_capstyle="butt")
        high = max(heights.max() for heights in (rim, *others))
        axes.annotate(str(number), (x, high), textcoords="offset points", xytext=(0, 4), ha="center", color=GATE)
    axes.set_ylim(0.0, None)
    axes.margins(y=0.2)
    tidy(axes, "Heights", "distance along that line [m]", "z [m]")
