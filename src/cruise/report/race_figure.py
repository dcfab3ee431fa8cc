"""One race as a picture: where it was flown, who led, how fast and how high."""

import io
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from cruise.evaluation.metrics import RaceResult, crossing_times, race_result
from cruise.storage.race_log import COLLISIONS, EVENT_KINDS, RaceLog

# Okabe and Ito's colours, distinct to colour-blind eyes, without yellow, which white swallows.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")
DASHES = ("-", "--", ":")  # tell drones of the same colour apart
Style = dict[str, Any]

INK, GATE, FAINT = "#222222", "#444444", "#9a9a9a"
MARKS = 8  # about so many time marks on the last lap
ROUND_SECONDS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
HALO = [withStroke(linewidth=2.5, foreground="white")]  # keeps writing readable on lines
START_WIDTH = 0.6  # of the way to the first gate, which is shorter than the others, in gates


class _Scene(NamedTuple):
    """What every panel needs."""

    log: RaceLog
    result: RaceResult
    crossings: np.ndarray  # [N, C] s
    progress: np.ndarray  # [T, N] gates flown, fractions between by time


def draw_race(log: RaceLog) -> bytes:
    """A PNG picture: top view, gaps, speeds and heights over the gates of the race, and the result."""
    crossings = crossing_times(log)
    scene = _Scene(log, race_result(log), crossings, _progress(log, crossings))
    figure = Figure(figsize=(15, 9.5), layout="constrained", facecolor="white")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.08, 1.0), height_ratios=(1.1, 1.0, 0.9))
    left = figure.add_subfigure(grid[:, 0]).subplots(2, 1, height_ratios=(5.0, 1.0 + 0.16 * log.num_drones))
    _top_view(left[0], scene)
    _result_table(left[1], scene)
    gap = figure.add_subplot(grid[0, 1])
    speed, height = (figure.add_subplot(grid[row, 1], sharex=gap) for row in (1, 2))
    _gaps(gap, scene)
    _speeds(speed, scene)
    _heights(height, scene)
    _gate_axis((gap, speed, height), scene)
    figure.suptitle(_title(scene), fontsize=15, fontweight="bold", color=INK)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110, metadata={"Software": None})
    return picture.getvalue()


def _style(drone: int) -> Style:
    return {"color": COLOURS[drone % len(COLOURS)], "linestyle": DASHES[drone // len(COLOURS) % len(DASHES)]}


def _colour(drone: int) -> str:
    return COLOURS[drone % len(COLOURS)]


def _title(scene: _Scene) -> str:
    log, winner = scene.log, scene.result.winner
    laps = "1 lap" if log.laps == 1 else f"{log.laps} laps"
    end = "nobody finished"
    if winner >= 0:
        end = f"drone {winner + 1} wins in {scene.result.drones[winner].finish_time:.2f} s"
    return f"{log.track}, {laps}: {end}"


def _progress(log: RaceLog, crossings: np.ndarray) -> np.ndarray:
    """[T, N] gates flown: 1 at the first crossing, linear in time between two, `START_WIDTH` before the first.

    Where a drone never came to its next gate, it moves at the pace of those that did.
    """
    starts = np.hstack([np.zeros((log.num_drones, 1)), crossings])
    paces = np.diff(starts, axis=1)
    usual = np.nanmedian(paces) if np.isfinite(paces).any() else max(float(log.time[-1]), log.control_dt)
    rows = []
    for mine in starts:
        known = mine[np.isfinite(mine)]
        number = np.arange(len(known), dtype=np.float64)
        number[0] = 1 - START_WIDTH
        beyond = np.append(known, known[-1] + 1.3 * usual), np.append(number, number[-1] + 1.0)
        rows.append(np.interp(log.time, *beyond))
    return np.stack(rows, axis=1)


def _flown(scene: _Scene, drone: int) -> slice:
    """Samples up to the one at which a drone finished or was out."""
    return slice(0, int(scene.log.airborne[:, drone].sum()) + 1)


def _crashes(log: RaceLog) -> Iterator[tuple[int, int]]:
    """Drones that collided, each with its last sample."""
    kinds = np.isin(log.event_kind, [EVENT_KINDS.index(name) for name in COLLISIONS])
    for drone in np.unique(log.event_drone[kinds]).tolist():
        yield drone, min(int(log.airborne[:, drone].sum()), len(log.time) - 1)


def _tidy(axes: Axes, title: str, label: str) -> None:
    axes.set_title(title, loc="left", fontsize=11, color=INK)
    axes.set_ylabel(label)
    axes.grid(color="#e6e6e6", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _top_view(axes: Axes, scene: _Scene) -> None:
    log = scene.log
    for drone in range(log.num_drones):
        x, y = log.position_w[_flown(scene, drone), drone, :2].T
        axes.plot(x, y, linewidth=1.3, alpha=0.75, **_style(drone))
        ring: Style = {"markerfacecolor": "white", "markeredgecolor": _colour(drone), "markeredgewidth": 1.8}
        axes.plot(x[0], y[0], "o", markersize=7, **ring)
    seconds = _time_marks(axes, scene)
    for drone, sample in _crashes(log):
        x, y = log.position_w[sample, drone, :2]
        axes.plot(x, y, "X", markersize=12, color=_colour(drone), markeredgecolor="white", zorder=6)
    _gates_from_above(axes, log)
    _tidy(axes, f"Seen from above (rings: start; dots: every {seconds:g} s at the end; crosses: collisions)", "y [m]")
    axes.set_xlabel("x [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.08)


def _gates_from_above(axes: Axes, log: RaceLog) -> None:
    """Openings as bars, an arrow in the direction of flight, the gate's number on the side away from the middle."""
    middle = log.gate_position[:, :2].mean(axis=0)
    gates = zip(log.gate_position, log.gate_yaw, log.gate_size, strict=True)
    for number, (centre, yaw, size) in enumerate(gates, start=1):
        forward, side = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        ends = np.stack([centre[:2] - side * size[0] / 2, centre[:2] + side * size[0] / 2])
        axes.plot(*ends.T, color=GATE, linewidth=4, solid_capstyle="butt", zorder=4)
        axes.annotate(
            "",
            xy=centre[:2] + 1.1 * forward,
            xytext=centre[:2] + 0.1 * forward,
            arrowprops={"arrowstyle": "-|>", "color": GATE, "linewidth": 1.2},
            zorder=4,
        )
        outward = side if side @ (centre[:2] - middle) >= 0 else -side
        place = centre[:2] + outward * (size[0] / 2 + 0.8)
        axes.text(place[0], place[1], str(number), ha="center", va="center", fontsize=12, fontweight="bold", color=GATE)
        axes.update_datalim([place])


def _time_marks(axes: Axes, scene: _Scene) -> float:
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
        colours = [_colour(drone) for drone in flying]
        axes.scatter(places[:, 0], places[:, 1], s=34, c=colours, edgecolors="white", linewidths=0.7, zorder=5)
        first = places[np.argmax(scene.progress[sample, flying])]
        if written is None or np.linalg.norm(first - written) > 1.0:
            _write_time(axes, f"{moment:g} s", first, log.gate_position[:, :2].mean(axis=0))
            written = first
    return seconds


def _write_time(axes: Axes, text: str, place: np.ndarray, middle: np.ndarray) -> None:
    """Beside `place`, on the side away from the middle of the track."""
    outward = (place - middle) / max(float(np.linalg.norm(place - middle)), 1e-9)
    style: Style = {"fontsize": 9, "color": INK, "ha": "center", "va": "center", "path_effects": HALO, "zorder": 6}
    axes.annotate(text, place, textcoords="offset points", xytext=tuple(17 * outward), **style)


def _last_lap(scene: _Scene) -> tuple[float, float]:
    """When the drone that is first began and ended its last lap; the whole log where nobody flew one [s]."""
    log, best = scene.log, scene.result.ranking[0]
    mine = scene.crossings[best][np.isfinite(scene.crossings[best])]
    if len(mine) <= log.num_gates:
        return 0.0, max(float(log.time[-1]), log.control_dt)
    return float(mine[-1 - log.num_gates]), float(mine[-1])


def _gaps(axes: Axes, scene: _Scene) -> None:
    """Time behind the first at every crossing; rings where a drone had just overtaken."""
    crossings = scene.crossings
    first = np.fmin.reduce(crossings, axis=0)
    gaps = crossings - first
    number = np.arange(1, crossings.shape[1] + 1)
    for drone in range(scene.log.num_drones):
        axes.plot(number, gaps[drone], marker="o", markersize=3.5, linewidth=1.6, **_style(drone))
    for drone, crossing in _overtakers(crossings):
        ring: Style = {"markerfacecolor": "none", "markeredgecolor": _colour(drone), "markeredgewidth": 1.6}
        axes.plot(number[crossing], gaps[drone, crossing], "o", markersize=11, **ring)
    for drone, sample in _crashes(scene.log):
        last = gaps[drone][np.isfinite(gaps[drone])]
        place = scene.progress[sample, drone], last[-1] if len(last) else 0.0
        axes.plot(*place, "X", markersize=10, color=_colour(drone), markeredgecolor="white")
    largest = max(0.5, float(np.fmax.reduce(gaps, axis=None)) if np.isfinite(gaps).any() else 0.0)
    axes.set_ylim(1.08 * largest, -0.1 * largest)
    _tidy(axes, "Behind the first at every gate (rings: just overtook; crosses: collisions)", "gap [s]")


def _overtakers(crossings: np.ndarray) -> list[tuple[int, int]]:
    """Drones that were behind another at a crossing and before it at the next, with that crossing."""
    behind = crossings[:, None] - crossings[None]  # > 0 where the first drone is behind the second
    passed = (behind[..., :-1] > 0) & (behind[..., 1:] < 0)
    drones, crossing = np.nonzero(passed.any(axis=1))
    return list(zip(drones.tolist(), (crossing + 1).tolist(), strict=True))


def _speeds(axes: Axes, scene: _Scene) -> None:
    speed = np.linalg.norm(scene.log.velocity_w, axis=2)
    _over_gates(axes, scene, speed)
    axes.set_ylim(0.0, max(1.0, 1.05 * float(speed.max())))
    _tidy(axes, "Speed", "[m/s]")


def _heights(axes: Axes, scene: _Scene) -> None:
    """Heights, and the openings of the gates as bars."""
    log = scene.log
    for crossing in range(log.gates_to_finish):
        gate = (log.next_gate[0, 0] + crossing) % log.num_gates
        centre, half = log.gate_position[gate, 2], log.gate_size[gate, 1] / 2
        opening = [max(centre - half, 0.0), centre + half]
        axes.plot([crossing + 1] * 2, opening, color="#cfcfcf", linewidth=5, solid_capstyle="butt")
    _over_gates(axes, scene, log.position_w[..., 2])
    _tidy(axes, "Height (bars: openings of the gates)", "z [m]")


def _over_gates(axes: Axes, scene: _Scene, values: np.ndarray) -> None:
    """[T, N] values over the progress of every drone."""
    for drone in range(scene.log.num_drones):
        flown = _flown(scene, drone)
        axes.plot(scene.progress[flown, drone], values[flown, drone], linewidth=1.3, alpha=0.85, **_style(drone))
    for drone, sample in _crashes(scene.log):
        place = scene.progress[sample, drone], values[sample, drone]
        axes.plot(*place, "X", markersize=9, color=_colour(drone), markeredgecolor="white", zorder=5)


def _gate_axis(panels: tuple[Axes, ...], scene: _Scene) -> None:
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


def _result_table(axes: Axes, scene: _Scene) -> None:
    """The result, best first."""
    axes.axis("off")
    rows: list[tuple[str, ...]] = [("", "drone", "pilot", "gates", "time", "best lap", "top speed")]
    rows += [_result_row(scene, rank, drone) for rank, drone in enumerate(scene.result.ranking, start=1)]
    columns = (0.0, 0.07, 0.2, 0.55, 0.72, 0.86, 1.0)
    for line, row in enumerate(rows):
        y = 1 - (line + 0.5) / len(rows)
        for column, (x, text) in enumerate(zip(columns, row, strict=True)):
            side = "left" if column < 3 else "right"
            style: Style = {"fontsize": 10, "fontweight": "bold" if line == 0 else "normal", "color": INK}
            axes.text(x, y, text, ha=side, va="center", transform=axes.transAxes, **style)
        if line:
            drone = scene.result.ranking[line - 1]
            axes.plot([0.025, 0.06], [y, y], transform=axes.transAxes, linewidth=3, clip_on=False, **_style(drone))


def _result_row(scene: _Scene, rank: int, drone: int) -> tuple[str, ...]:
    mine, log = scene.result.drones[drone], scene.log
    pilot = str(log.pilots[drone])
    time = f"{mine.finish_time:.2f} s" if mine.finished else mine.fate
    best = "" if np.isnan(mine.best_lap) else f"{mine.best_lap:.2f} s"
    gates = f"{mine.gates_passed} of {log.gates_to_finish}"
    short = pilot if len(pilot) <= 28 else pilot[:27] + "\u2026"
    return str(rank), f"drone {drone + 1}", short, gates, time, best, f"{mine.top_speed:.2f} m/s"
