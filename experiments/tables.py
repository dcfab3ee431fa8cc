"""The report's tables, from the evidence."""

from collections.abc import Sequence

from cruise.presets import CURRICULUM, PAPER_TRACKS
from experiments.claims import claims_table
from experiments.entries import NOT_RUN, number, quantity, scale_note, seeds
from experiments.evidence import Evidence
from experiments.meeting_tables import duel_table, field_table
from experiments.plan import ABLATION_DRONES, ABLATIONS, KINDS
from experiments.pooling import Pooled, Summary
from experiments.printed import LIMITS, STAGE_SPEEDS, TABLES, Printed
from experiments.ratings import Rating
from experiments.results import Cell
from experiments.table import Entry, Number, Table
from experiments.trials import trial_table

NOT_PRINTED = ""  # of pilots that the paper does not have
PERFORMANCE = ("cruise", "se-ibr", "se-ibr-tuned", "vanilla", "vanilla-stage5", "self-play-only")


def performance_table(evidence: Evidence, track: str) -> Table:
    """The paper's table of a track, printed and measured side by side."""
    rows = [_performance(evidence, track, n, kind) for n in evidence.scale.drones for kind in PERFORMANCE]
    return Table(
        f"performance-{track}",
        f"{track}: the paper's table, printed and measured",
        (
            "drones",
            "pilot",
            "lap printed [s]",
            "nominal lap [s]",
            "timed flying lap [s]",
            "speed printed [m/s]",
            "mean speed [m/s]",
            "success printed [%]",
            "success per drone [%]",
            "races all finish [%]",
            "seeds",
        ),
        tuple(rows),
        scale_note(evidence),
    )


def _performance(evidence: Evidence, track: str, drones: int, kind: str) -> tuple[Entry, ...]:
    summary, printed = evidence.summary(kind, track, drones), TABLES.get((track, kind, drones))
    return (
        str(drones),
        KINDS[kind].title,
        _printed(printed, "lap"),
        quantity(summary, "nominal_lap"),
        quantity(summary, "lap"),
        _printed(printed, "speed"),
        quantity(summary, "speed"),
        NOT_PRINTED if printed is None else f"{printed.success:g}",
        quantity(summary, "success", 100, 1),
        quantity(summary, "all_success", 100, 1),
        seeds(summary),
    )


def _printed(printed: Printed | None, name: str) -> str:
    if printed is None:
        return NOT_PRINTED
    mean, std = getattr(printed, name), getattr(printed, f"{name}_std")
    return "N/A" if mean is None else f"{mean:.1f} ± {std:.1f}"


def stage_table(evidence: Evidence) -> Table:
    """CRUISE after every stage, beside the paper's repository."""
    rows: list[tuple[Entry, ...]] = []
    for track in evidence.scale.tracks:
        for drones in evidence.scale.drones:
            stages = evidence.stages("cruise", track, drones)
            for stage in range(1, len(CURRICULUM) + 1):
                summary = stages.get(stage)
                printed = STAGE_SPEEDS[track, drones][stage - 1]
                measured = (
                    quantity(summary, "air_speed"),
                    quantity(summary, "lap"),
                    quantity(summary, "success", 100, 1),
                )
                rows.append((track, str(drones), str(stage), f"{printed:.2f}", *measured))
    return Table(
        "stages",
        "CRUISE after every stage of the curriculum",
        ("track", "drones", "stage", "speed, paper's files [m/s]", "speed [m/s]", "timed lap [s]", "success [%]"),
        tuple(rows),
        scale_note(evidence),
    )


def ablation_table(evidence: Evidence) -> Table:
    """What each ingredient does, for four drones."""
    kinds = ("cruise", *ABLATIONS, "vanilla")
    rows = [
        (track, KINDS[kind].title, KINDS[kind].summary, *_ablation(evidence.summary(kind, track, ABLATION_DRONES)))
        for track in evidence.scale.tracks
        for kind in kinds
    ]
    return Table(
        "ablations",
        "What each ingredient does: four drones",
        ("track", "training", "what it is", "success [%]", "mean speed [m/s]", "timed lap [s]", "collisions", "seeds"),
        tuple(rows),
        scale_note(evidence),
    )


def _ablation(summary: Summary | None) -> tuple[Entry, ...]:
    quantities = (
        quantity(summary, "success", 100, 1),
        quantity(summary, "speed"),
        quantity(summary, "lap"),
        quantity(summary, "collisions"),
    )
    return (*quantities, seeds(summary))


def limit_table(evidence: Evidence) -> Table:
    """Timed laps against the fastest possible."""
    pilots = ("cruise", "vanilla", "se-ibr", "se-ibr-tuned")
    rows: list[tuple[Entry, ...]] = [
        (f"limit: {limit.name}", "1", Number(limit.ring), Number(limit.figure_eight), "", "") for limit in LIMITS
    ]
    for kind in pilots:
        for drones in evidence.scale.drones:
            laps = [_lap(evidence, kind, track, drones) for track in ("ring", "figure-eight")]
            over = [_over(lap, LIMITS[1].lap(track)) for lap, track in zip(laps, ("ring", "figure-eight"), strict=True)]
            rows.append((KINDS[kind].title, str(drones), *(number(lap) for lap in laps), *over))
    return Table(
        "limits",
        "Timed laps beside the fastest laps this vehicle can fly",
        ("pilot", "drones", "ring [s]", "figure-eight [s]", "ring, above the limit [%]", "figure-eight, above [%]"),
        tuple(rows),
        scale_note(evidence),
    )


def _lap(evidence: Evidence, kind: str, track: str, drones: int) -> Pooled | None:
    summary = evidence.summary(kind, track, drones)
    return summary.lap if summary else None


def _over(lap: Pooled | None, limit: float) -> Entry:
    if lap is None:
        return NOT_RUN
    mean, low, high = (100 * (value / limit - 1) for value in (lap.mean, lap.low, lap.high))
    return Number(mean, low, high, digits=1)


def _in_order(cell: Cell) -> tuple[int, int, int, int]:
    """Kinds and tracks as they are planned."""
    return list(KINDS).index(cell.kind), list(PAPER_TRACKS).index(cell.track), cell.drones, cell.seed


def runs_table(evidence: Evidence) -> Table:
    """Everything that was run, and what to type to run it again."""
    rows: list[tuple[Entry, ...]] = []
    for cell in sorted(evidence.all_cells, key=_in_order):
        steps = Number(cell.steps / 1e6, digits=2) if cell.steps else "-"
        minutes = Number(cell.training_seconds / 60, digits=1) if cell.steps else "-"
        place = (KINDS[cell.kind].title, cell.track, str(cell.drones), str(cell.seed))
        made = (f"{cell.origin.version}, jax {cell.origin.jax}", cell.origin.platform)
        rows.append((*place, steps, minutes, str(len(cell.measured.success)), *made, cell.origin.command))
    header = ("pilot", "track", "drones", "seed", "steps [M]", "training [min]", "races", "version", "on", "command")
    return Table("runs", "Every run", header, tuple(rows), scale_note(evidence))


def all_tables(evidence: Evidence, ratings: dict[str, list[Rating]]) -> Sequence[Table]:
    """All of them."""
    return (
        claims_table(evidence),
        *(performance_table(evidence, track) for track in evidence.scale.tracks),
        stage_table(evidence),
        ablation_table(evidence),
        trial_table(evidence.trials),
        duel_table(evidence),
        field_table(evidence, ratings),
        limit_table(evidence),
        runs_table(evidence),
    )
