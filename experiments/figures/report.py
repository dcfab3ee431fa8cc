"""The report's figures, from the evidence."""

import math
from collections.abc import Callable, Sequence

from matplotlib.figure import Figure

from cruise.presets import CURRICULUM, PAPER_TRACKS
from cruise.report.figure_style import BLACK, BLUE, GREEN, ORANGE, PINK, SKY, VERMILION
from cruise.storage.race_log import RaceLog
from experiments.evidence import Evidence
from experiments.figures.comparison import Dot, Panel, Series, draw_comparison
from experiments.figures.curve import CurveLine, CurvePanel, draw_curves
from experiments.figures.listing import Listing, draw_listings
from experiments.figures.matrix import Matrix, draw_matrices
from experiments.figures.paths import draw_paths
from experiments.figures.stage import StageLine, StagePanel, draw_stages
from experiments.plan import ABLATION_DRONES, ABLATIONS, DUEL, ENTRANTS, KINDS, MIXED
from experiments.pooling import Pooled, Summary
from experiments.printed import FREE, GENTLE, STAGE_SPEEDS, TABLES
from experiments.ratings import Rating, win_rate
from experiments.results import Cell

COLOURS = {
    "cruise": BLUE,
    "vanilla": ORANGE,
    "se-ibr": GREEN,
    "se-ibr-tuned": VERMILION,
    "self-play-only": PINK,
    "vanilla-stage5": "#B0771C",
    "curriculum-only": SKY,
    "self-play-after": BLACK,
    "copies-only": "#3B7A3B",
    "paper-reward": "#7A7A7A",
    "paper-observation": "#8C6BB1",
}
DRONE_COLOURS = {2: BLUE, 3: ORANGE, 4: GREEN}


def dot(pooled: Pooled | None, factor: float = 1.0, printed: float | None = None) -> Dot | None:
    """A pooled quantity as a figure shows it; None where there is nothing to show."""
    if pooled is None or not pooled.known:
        return None if printed is None else Dot(math.nan, printed=printed)
    return Dot(factor * pooled.mean, factor * pooled.low, factor * pooled.high, printed)


Quantity = Callable[[Summary], Pooled]


def overview(evidence: Evidence) -> Figure:
    """Success, speed and lap of all pilots."""
    kinds = ("cruise", "vanilla", "se-ibr", "se-ibr-tuned", "self-play-only")
    rows = [
        [_panel(evidence, track, kinds, "success", "finished, per drone [%]", 100) for track in evidence.scale.tracks],
        [_panel(evidence, track, kinds, "speed", "mean speed [m/s]", 1) for track in evidence.scale.tracks],
        [_panel(evidence, track, kinds, "lap", "timed flying lap [s]", 1) for track in evidence.scale.tracks],
    ]
    return draw_comparison(rows)


def _panel(evidence: Evidence, track: str, kinds: Sequence[str], name: str, unit: str, factor: float) -> Panel:
    drones = evidence.scale.drones
    series = []
    for kind in kinds:
        dots = []
        for n in drones:
            summary, printed = evidence.summary(kind, track, n), TABLES.get((track, kind, n))
            pooled = getattr(summary, name) if summary else None
            dots.append(dot(pooled, factor, getattr(printed, name, None) if name != "lap" else None))
        series.append(Series(KINDS[kind].title, COLOURS[kind], tuple(dots)))
    lines = ((FREE.lap(track), "limit"),) if name == "lap" else ()
    groups, high = tuple(f"{n} drones" for n in drones), 105.0 if name == "success" else None
    return Panel(f"{track}: {unit.partition(' [')[0]}", unit, groups, tuple(series), lines, high)


def stages(evidence: Evidence) -> Figure:
    """Mean speed after every stage, as in the paper's ablation figures."""
    panels = []
    for track in evidence.scale.tracks:
        lines = []
        for n in evidence.scale.drones:
            found = evidence.stages("cruise", track, n)
            points = tuple((k, s.air_speed.mean, s.air_speed.low, s.air_speed.high) for k, s in found.items())
            lines.append(StageLine(f"{n} drones", DRONE_COLOURS.get(n, BLACK), points, STAGE_SPEEDS[track, n]))
        panels.append(StagePanel(PAPER_TRACKS[track], f"{track}: mean speed in the air", "m/s", tuple(lines), 5.0))
    return draw_stages(panels, [stage.name for stage in CURRICULUM])


CURVE_KINDS = ("cruise", "vanilla", "curriculum-only", "self-play-only")


def curves(evidence: Evidence) -> Figure:
    """Survival and speed in evaluations while learning."""
    drones = max(evidence.scale.drones)
    rows = []
    for name, title, high in (("success", "survived evaluation races", 1.05), ("speed", "mean speed [m/s]", math.nan)):
        row = []
        for track in evidence.scale.tracks:
            lines = [
                _curve_line(kind, cell, name)
                for kind in CURVE_KINDS
                for cell in evidence.of(kind, track, drones)
                if cell.curve
            ]
            row.append(CurvePanel(f"{track}, {drones} drones", title, tuple(lines), _edges(evidence), high))
        rows.append(row)
    return draw_curves(rows)


def _edges(evidence: Evidence) -> tuple[float, ...]:
    steps, edges = 0.0, []
    for stage in CURRICULUM[:-1]:
        steps += stage.steps * evidence.scale.step_scale / 1e6
        edges.append(steps)
    return tuple(edges)


def _curve_line(kind: str, cell: Cell, name: str) -> CurveLine:
    assert cell.curve is not None
    values = tuple(math.nan if v is None else v for v in getattr(cell.curve, name))
    steps = tuple(step / 1e6 for step in cell.curve.steps)
    return CurveLine(KINDS[kind].title, COLOURS[kind], CURVE_KINDS.index(kind), steps, values)


def duels(evidence: Evidence) -> Figure:
    """The win-rate matrices."""
    names = tuple(KINDS[kind].title for kind in ENTRANTS)
    matrices = []
    for track in evidence.scale.tracks:
        met = evidence.met(track, DUEL)
        rates = tuple(
            tuple(None if one == other else _rate(win_rate(met, one, other)) for other in ENTRANTS) for one in ENTRANTS
        )
        matrices.append(Matrix(f"{track}: the pilot of the row wins", names, rates))
    return draw_matrices(matrices)


def _rate(pooled: Pooled) -> tuple[float, float, float]:
    return pooled.mean, pooled.low, pooled.high


def ratings_figure(evidence: Evidence, ratings: dict[str, list[Rating]]) -> Figure:
    """Ratings per track."""
    row = []
    for track in evidence.scale.tracks:
        skills = {rating.entrant: rating.skill for rating in ratings.get(track, [])}
        rows = tuple((KINDS[kind].title, COLOURS[kind], dot(skills.get(kind))) for kind in ENTRANTS)
        row.append(Listing(f"{track}: rating", "skill (25: the start)", rows))
    return draw_listings([row])


def limits(evidence: Evidence) -> Figure:
    """Timed laps against what the vehicle can do."""
    row = []
    for track in evidence.scale.tracks:
        panel = _panel(evidence, track, ENTRANTS, "lap", "timed flying lap [s]", 1)
        lines = ((FREE.lap(track), "free"), (GENTLE.lap(track), "gentle"))
        row.append(Panel(panel.title, panel.unit, panel.groups, panel.series, lines))
    return draw_comparison([row])


def ablations(evidence: Evidence) -> Figure:
    """What each ingredient does, for four drones."""
    panels = [
        [_ablation(evidence, track, "success", "finished, per drone [%]", 100) for track in evidence.scale.tracks],
        [_ablation(evidence, track, "lap", "timed flying lap [s]", 1) for track in evidence.scale.tracks],
    ]
    return draw_listings(panels)


def _ablation(evidence: Evidence, track: str, name: str, unit: str, factor: float) -> Listing:
    rows = []
    for kind in ("cruise", *ABLATIONS, "vanilla"):
        summary = evidence.summary(kind, track, ABLATION_DRONES)
        rows.append((KINDS[kind].title, COLOURS[kind], dot(getattr(summary, name) if summary else None, factor)))
    lines = ((FREE.lap(track), "limit"),) if name == "lap" else ()
    return Listing(f"{track}: {unit.partition(' [')[0]}", unit, tuple(rows), lines)


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


def all_figures(evidence: Evidence, ratings: dict[str, list[Rating]]) -> dict[str, Figure]:
    """By name."""
    return {
        "overview": overview(evidence),
        "stages": stages(evidence),
        "learning-curves": curves(evidence),
        "ablations": ablations(evidence),
        "duels": duels(evidence),
        "ratings": ratings_figure(evidence, ratings),
        "limits": limits(evidence),
        **paths(evidence),
    }
