"""One race as a picture: where it was flown, who led, how fast and how high."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from cruise.palette import drone_colour as colour
from cruise.report import race_charts as charts
from cruise.report.figure_style import INK, Style, our_look, tidy, to_png
from cruise.report.race_scene import Scene, crashes, flown, make_scene, style
from cruise.report.track_figure import track_from_above
from cruise.storage.log_track import gates_of, solids_of
from cruise.storage.race_log import RaceLog

MARKS = 8  # about so many time marks on the last lap
ROUND_SECONDS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
HALO = [withStroke(linewidth=2.5, foreground="white")]  # keeps writing readable on lines


@our_look()
def draw_race(log: RaceLog) -> bytes:
    """A PNG picture: top view, gaps, speeds and heights over the gates of the race, and the result."""
    scene = make_scene(log)
    figure = Figure(figsize=(15, 9.5), layout="constrained", facecolor="white")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.08, 1.0), height_ratios=(1.1, 1.0, 0.9))
    left = figure.add_subfigure(grid[:, 0]).subplots(2, 1, height_ratios=(5.0, 1.0 + 0.16 * log.num_drones))
    _top_view(left[0], scene)
    _result_table(left[1], scene)
    gap = figure.add_subplot(grid[0, 1])
    speed, height = (figure.add_subplot(grid[row, 1], sharex=gap) for row in (1, 2))
    charts.draw_gaps(gap, scene)
    charts.draw_speeds(speed, scene)
    charts.draw_heights(height, scene)
    charts.share_gate_axis((gap, speed, height), scene)
    figure.suptitle(_title(scene), fontsize=15, fontweight="bold", color=INK)
    return to_png(figure)


def _title(scene: Scene) -> str:
    log, winner = scene.log, scene.result.winner
    laps = "1 lap" if log.laps == 1 else f"{log.laps} laps"
    end = "nobody finished"
    if winner >= 0:
        end = f"drone {winner + 1} wins in {scene.result.drones[winner].finish_time:.2f} s"
    return f"{log.track}, {laps}: {end}"


def _top_view(axes: Axes, scene: Scene) -> None:
    log = scene.log
    for drone in range(log.num_drones):
        x, y = log.position_w[flown(scene, drone), drone, :2].T
        axes.plot(x, y, linewidth=1.3, alpha=0.75, **style(drone))
        ring: Style = {"markerfacecolor": "white", "markeredgecolor": colour(drone), "markeredgewidth": 1.8}
        axes.plot(x[0], y[0], "o", markersize=7, **ring)
    seconds = _time_marks(axes, scene)
    for drone, sample in crashes(log):
        x, y = log.position_w[sample, drone, :2]
        axes.plot(x, y, "X", markersize=12, color=colour(drone), markeredgecolor="white", zorder=6)
    track_from_above(axes, gates_of(log), solids_of(log))
    title = f"Seen from above (rings: start; dots: every {seconds:g} s at the end; crosses: collisions)"
    tidy(axes, title, "x [m]", "y [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)


def _time_marks(axes: Axes, scene: Scene) -> float:
    """Where every drone was at round times of the first one's last lap, the time beside it; gives the interval [s]."""
    log = scene.log
    start, end = _last_lap(scene)
    seconds = min(ROUND_SECONDS, key=lambda s: abs(np.log(s * MARKS / (end - start))))
    written = None
    for moment in np.arange(np.ceil(start / seconds), np.ceil(end / seconds)) * seconds:
        sample = min(round(moment / log.control_dt), len(log.time) - 1)
        flying = np.flatnonzero(log.airborne[sample]).tolist()
        if len(flying) == 0:
            continue
        places = log.position_w[sample, flying, :2]
        colours = [colour(drone) for drone in flying]
        axes.scatter(places[:, 0], places[:, 1], s=34, c=colours, edgecolors="white", linewidths=0.7, zorder=5)
        first = places[np.argmax(scene.progress[sample, flying])]
        if written is None or np.linalg.norm(first - written) > 1.0:
            _write_time(axes, f"{moment:g} s", first, log.gate_position[:, :2].mean(axis=0))
            written = first
    return seconds


def _write_time(axes: Axes, text: str, place: np.ndarray, middle: np.ndarray) -> None:
    """Beside `place`, on the side away from the middle of the track."""
    outward = (place - middle) / max(float(np.linalg.norm(place - middle)), 1e-9)
    look: Style = {"fontsize": 9, "color": INK, "ha": "center", "va": "center", "path_effects": HALO, "zorder": 6}
    axes.annotate(text, tuple(place), textcoords="offset points", xytext=tuple(17 * outward), **look)


def _last_lap(scene: Scene) -> tuple[float, float]:
    """When the drone that is first began and ended its last lap; the whole log where nobody flew one [s]."""
    log, best = scene.log, scene.result.ranking[0]
    mine = scene.crossings[best][np.isfinite(scene.crossings[best])]
    if len(mine) <= log.num_gates:
        return 0.0, max(float(log.time[-1]), log.control_dt)
    return float(mine[-1 - log.num_gates]), float(mine[-1])


def _result_table(axes: Axes, scene: Scene) -> None:
    """The result, best first."""
    axes.axis("off")
    rows: list[tuple[str, ...]] = [("", "drone", "pilot", "gates", "time", "best lap", "top speed")]
    rows += [_result_row(scene, rank, drone) for rank, drone in enumerate(scene.result.ranking, start=1)]
    columns = (0.0, 0.07, 0.2, 0.55, 0.72, 0.86, 1.0)
    for line, row in enumerate(rows):
        y = 1 - (line + 0.5) / len(rows)
        for column, (x, text) in enumerate(zip(columns, row, strict=True)):
            side = "left" if column < 3 else "right"
            look: Style = {"fontsize": 10, "fontweight": "bold" if line == 0 else "normal", "color": INK}
            axes.text(x, y, text, ha=side, va="center", transform=axes.transAxes, **look)
        if line:
            drone = scene.result.ranking[line - 1]
            axes.plot([0.025, 0.06], [y, y], transform=axes.transAxes, linewidth=3, clip_on=False, **style(drone))


def _result_row(scene: Scene, rank: int, drone: int) -> tuple[str, ...]:
    mine, log = scene.result.drones[drone], scene.log
    pilot = str(log.pilots[drone])
    time = f"{mine.finish_time:.2f} s" if mine.finished else mine.fate
    best = "" if np.isnan(mine.best_lap) else f"{mine.best_lap:.2f} s"
    gates = f"{mine.gates_passed} of {log.gates_to_finish}"
    short = pilot if len(pilot) <= 28 else pilot[:27] + "\u2026"
    return str(rank), f"drone {drone + 1}", short, gates, time, best, f"{mine.top_speed:.2f} m/s"
