"""Kinds of pilots one below the other, a value each: easier to read than a legend where there is one group alone."""

import math
from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.palette import FAINT, INK
from cruise.report.figure_style import Style, tidy
from experiments.evidence import Evidence
from experiments.figures.style import COLOURS, LAP, SUCCESS, panels
from experiments.plan import ABLATION_DRONES, ABLATIONS, ENTRANTS, KINDS
from experiments.pooling import Pooled
from experiments.printed import FREE
from experiments.ratings import Rating

Rows = Mapping[str, Pooled | None]  # by kind; None where nothing was observed
INGREDIENTS = ("cruise", *ABLATIONS, "vanilla")


def ablations(evidence: Evidence) -> Figure:
    """What each ingredient does, for four drones."""
    tracks, quantities = evidence.scale.tracks, (SUCCESS, LAP)
    size = 5.6 * len(tracks), (0.36 * len(INGREDIENTS) + 0.9) * len(quantities)
    figure, grid = panels(*size, (len(quantities), len(tracks)), sharey="row")
    for axes_row, quantity in zip(grid, quantities, strict=True):
        for axes, track in zip(axes_row, tracks, strict=True):
            rows = {kind: quantity.of(evidence, kind, track, ABLATION_DRONES) for kind in INGREDIENTS}
            _draw(axes, rows)
            if quantity is LAP:
                _draw_limit(axes, FREE.lap(track))
            _finish(axes, rows, f"{track}: {quantity.title}", quantity.label)
        axes_row[0].set_ylim(len(INGREDIENTS) - 0.5, -0.5)
    return figure


def ratings_figure(evidence: Evidence, ratings: Mapping[str, list[Rating]]) -> Figure:
    """Ratings per track."""
    tracks = evidence.scale.tracks
    figure, grid = panels(5.6 * len(tracks), 0.36 * len(ENTRANTS) + 0.9, (1, len(tracks)), sharey="row")
    for axes, track in zip(grid[0], tracks, strict=True):
        skills = {rating.entrant: rating.skill for rating in ratings.get(track, []) if rating.skill.known}
        rows = {kind: skills.get(kind) for kind in ENTRANTS}
        _draw(axes, rows)
        _finish(axes, rows, f"{track}: rating", "skill (25: the start)")
    grid[0][0].set_ylim(len(ENTRANTS) - 0.5, -0.5)
    return figure


def _draw(axes: Axes, rows: Rows) -> None:
    for height, (kind, pooled) in enumerate(rows.items()):
        if pooled is None:
            look: Style = {"xycoords": ("axes fraction", "data"), "fontsize": 8, "color": FAINT, "va": "center"}
            axes.annotate("nothing measured", (0.01, height), **look)
            continue
        if not math.isnan(pooled.low):
            axes.plot([pooled.low, pooled.high], [height, height], color=COLOURS[kind], linewidth=2.5, alpha=0.55)
        axes.plot(pooled.mean, height, "o", markersize=7, color=COLOURS[kind])


def _draw_limit(axes: Axes, value: float) -> None:
    axes.axvline(value, color=INK, linewidth=1.0, linestyle=":", zorder=1)
    place: Style = {"xycoords": ("data", "axes fraction"), "ha": "left", "va": "bottom"}
    axes.annotate("limit", (value, 0.01), fontsize=8, color=INK, **place)


def _finish(axes: Axes, rows: Rows, title: str, label: str) -> None:
    tidy(axes, title, xlabel=label)
    axes.set_yticks(range(len(rows)), [KINDS[kind].title for kind in rows], fontsize=9)
