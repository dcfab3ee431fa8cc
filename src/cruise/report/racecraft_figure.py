"""One run of every scenario of racecraft: from above, and how far the others are ahead of the pilot."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import SubFigure

from cruise.evaluation.course_line import course_line
from cruise.evaluation.racecraft import PILOT, Outcome, Run
from cruise.palette import drone_colour as colour
from cruise.report.figure_style import INK, new_figure, our_look, tidy, to_png
from cruise.report.race_scene import crashes, style
from cruise.report.track_figure import track_from_above
from cruise.storage.log_track import gates_of, solids_of
from cruise.storage.race_log import RaceLog

COLUMNS = 3
AFTER = 2.0  # shown beyond the last change of places or contact [s]
SHORTEST = 6.0  # of what is shown [s]


@our_look()
def draw_racecraft(outcomes: Sequence[Outcome], title: str) -> bytes:
    """A PNG picture with a panel for each scenario, of its first run that went as most of them did."""
    rows = -(-len(outcomes) // COLUMNS)
    figure = new_figure(5.2 * COLUMNS, 6.4 * rows)
    figure.suptitle(title, fontsize=14, fontweight="bold", color=INK)
    panels = figure.subfigures(rows, COLUMNS, squeeze=False)
    for panel, outcome in zip(panels.ravel(), outcomes, strict=False):
        _draw(panel, outcome, typical_run(outcome))
    return to_png(figure)


def typical_run(outcome: Outcome) -> Run:
    """The first of the runs whose end is the most frequent one."""
    ends = [(run.finished, run.first, run.passes, len(run.contacts)) for run in outcome.runs]
    return outcome.runs[ends.index(max(ends, key=ends.count))]


def _draw(panel: SubFigure, outcome: Outcome, run: Run) -> None:
    above, gaps = panel.subplots(2, 1, height_ratios=(3.2, 1.0))
    log, ahead = run.log, _ahead_of_pilot(run.log)
    end = _shown_until(log, ahead)
    for drone in reversed(range(log.num_drones)):
        flown = slice(0, min(end, int(log.airborne[:, drone].sum())) + 1)
        x, y = log.position_w[flown, drone, :2].T
        above.plot(x, y, linewidth=2.2 if drone == PILOT else 1.3, alpha=0.85, **style(drone))
        above.plot(x[0], y[0], "o", markersize=6, markerfacecolor="white", markeredgecolor=colour(drone))
        if drone != PILOT:
            gaps.plot(log.time[flown], ahead[drone, flown], linewidth=1.5, **style(drone))
    for drone, sample in crashes(log):
        if sample <= end + 1:
            x, y = log.position_w[sample, drone, :2]
            above.plot(x, y, "X", markersize=11, color=colour(drone), markeredgecolor="white", zorder=6)
    track_from_above(above, gates_of(log), solids_of(log))
    gaps.axhline(0.0, color=colour(PILOT), linewidth=2.2)
    gaps.margins(x=0)
    tidy(above, f"{outcome.scenario.name}: {_told(run)}")
    above.set_aspect("equal", adjustable="datalim")
    tidy(gaps, "", "time [s]", "ahead of the pilot [m]")


def _ahead_of_pilot(log: RaceLog) -> np.ndarray:
    """[N, T] how far each drone is before the pilot along the course, counted on over the laps [m]."""
    line = course_line(log)
    rows = (line.coordinates(log.position_w[:, d], log.next_gate[:, d])[:, 0] for d in range(log.num_drones))
    along = np.unwrap(np.stack(list(rows)), period=line.length)
    ahead = along - along[PILOT]
    shown: np.ndarray = ahead + (line.ahead(ahead[:, :1], 0.0) - ahead[:, :1])
    return shown


def _shown_until(log: RaceLog, ahead: np.ndarray) -> int:
    """The sample a little after the last change of places or crash while the pilot flies."""
    end = int(log.airborne[:, PILOT].sum())
    changed = np.flatnonzero((np.diff(np.sign(ahead[:, :end]), axis=1) != 0).any(axis=0))
    crashed = [sample for _, sample in crashes(log) if sample <= end]
    last = max([*changed.tolist(), *crashed], default=0) * log.control_dt + AFTER
    return min(round(max(last, SHORTEST) / log.control_dt), end, len(log.time) - 1)


def _told(run: Run) -> str:
    """What came of it, in a few words."""
    end = ("first" if run.first else "not first") if run.finished else "did not finish"
    passes = f"{run.passes} passed" if run.passes else "nobody passed"
    touched = "".join(
        f", contact ({contact.rule}, {contact.fault_of(PILOT):.0%} its fault)" for contact in run.contacts
    )
    return f"{end}, {passes}{touched}"
