"""Draws the pictures of docs/curriculum.md from one training run: `python docs/draw_curriculum.py RUN`."""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import cruise
from cruise.presets import CURRICULUM
from cruise.report.figure_style import BLUE, FAINT, INK, ORANGE, VERMILION, new_figure, tidy
from cruise.report.race_scene import style
from cruise.storage.policy_file import read_policy
from cruise.storage.race_log import EventKind, RaceLog
from cruise.training.metrics_log import read_metrics
from experiments.figures.paths import gate_corners

IMAGES = Path(__file__).parent / "images"
SEED = 3  # of the races that are drawn


def draw_stages(run: Path) -> Figure:
    """The first 40 s of one race flown by the policy of every stage, from above, with the stage's rules above it."""
    figure = new_figure(14.0, 2.9)
    for number, (stage, axes) in enumerate(zip(CURRICULUM, figure.subplots(1, 5), strict=True), start=1):
        policy = read_policy(run / f"stage-{number}.safetensors")
        log = cruise.race(policy.meta.track, policy.meta.drones, [policy.pilot()], seed=SEED)
        _paths(axes, log, seconds=40.0)
        crash = "end the race" if stage.terminal_collisions else "cost" if stage.collision_penalty else "are free"
        rules = f"agility {stage.agility:g}, up to {stage.v_min:g} m/s\ncrashes {crash}"
        axes.set_title(f"{number} {stage.name}\n{rules}", fontsize=9, color=INK)
    return figure


def _paths(axes, log: RaceLog, seconds: float) -> None:
    samples = int(seconds / log.control_dt) + 1
    for drone in range(log.num_drones):
        flown = int(min(samples, log.airborne[:, drone].sum() + 1))
        axes.plot(*log.position_w[:flown, drone, :2].T, linewidth=0.9, alpha=0.85, **style(drone))
        if flown < samples and drone not in log.event_drone[log.event_kind == EventKind.FINISH]:
            axes.plot(*log.position_w[flown - 1, drone, :2], "X", color=style(drone)["color"], markeredgecolor="white")
    for corners in gate_corners(log):
        axes.plot(*corners[:2, :2].T, color=INK, linewidth=3.0, solid_capstyle="butt")
    reach = np.abs(log.gate_position[:, :2]).max(axis=0) + 2.5
    axes.set_xlim(-reach[0], reach[0])
    axes.set_ylim(-reach[1], reach[1])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_visible(False)


def draw_self_play(run: Path) -> Figure:
    """Win rate against the frozen opponents, and where they were replaced; lap time below it."""
    rows = [row for row in read_metrics(run) if "evaluation/win_rate" in row]
    steps = np.array([row["steps"] for row in rows]) / 1e6
    replaced = np.array([row["evaluation/opponents_replaced"] > 0 for row in rows])
    figure = new_figure(9.0, 5.0)
    above, below = figure.subplots(2, 1, sharex=True)
    wins = np.array([row["evaluation/win_rate"] for row in rows])
    above.plot(steps, wins, color=BLUE, linewidth=1)
    above.plot(steps[replaced], wins[replaced], "o", color=VERMILION, markersize=5, label="opponents replaced")
    above.axhline(0.6, color=FAINT, linestyle="--", linewidth=1, label="threshold")
    tidy(above, "Win rate of the policy against its frozen copies")
    above.legend(fontsize=8, frameon=False, ncols=2)
    timed = [(step, row["evaluation/lap_time"]) for step, row in zip(steps, rows, strict=True) if _timed(row)]
    below.plot(*zip(*timed, strict=True), color=ORANGE, linewidth=1.5)
    tidy(below, "Lap time in the same races [s]", "million steps")
    ends = np.cumsum([stage.steps for stage in CURRICULUM]) / 1e6
    for axes in (above, below):
        for end in ends[:-1]:
            axes.axvline(end, color=INK, linewidth=0.6, linestyle=":")
    for number, start in enumerate([0.0, *ends[:-1]], start=1):
        above.text(start + 0.15, 1.04, f"stage {number}" if number > 3 else str(number), fontsize=8, color=INK)
    above.set_ylim(-0.03, 1.12)
    return figure


def _timed(row: dict) -> bool:
    return "evaluation/lap_time" in row and row["evaluation/lap_time"] < 60


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    draw_stages(folder).savefig(IMAGES / "curriculum.png", dpi=100)
    draw_self_play(folder).savefig(IMAGES / "self-play.png", dpi=100)
