"""The report put together and written: report.html, report.md, figures and CSV files."""

from pathlib import Path

from cruise.report.figure_style import to_svg
from cruise.storage.atomic import write_atomically
from experiments.claims import claims_table
from experiments.document import Picture, Point, Report, Section, report_html, report_markdown
from experiments.entries import scale_note
from experiments.evidence import Evidence, mixed_settings
from experiments.figures.report import Drawing, all_figures
from experiments.headline import headline
from experiments.plan import KINDS, make_plan
from experiments.printed import PAPER
from experiments.ratings import Rating, rate
from experiments.reasons import reasons
from experiments.table import to_csv
from experiments.tables import all_tables

RACES = (
    "Two, three or four quadrotors race three laps through the gates of a ring or a figure-eight. A drone that "
    "collides is out. Who flies:"
)
NO_RACE = "Not run: no race of four has been kept yet."
FIGURES, TABLES = "figures", "tables"  # folders beside report.html and report.md


def write_report(evidence: Evidence, out: Path) -> Path:
    """Write the report of the evidence, the same for the same evidence, and give the path of its page."""
    report = make_report(evidence)
    write_atomically(out / "report.html", report_html(report).encode())
    write_atomically(out / "report.md", report_markdown(report, FIGURES).encode())
    for section in report.sections:
        for picture in section.pictures:
            write_atomically(out / FIGURES / f"{picture.name}.svg", picture.svg.encode())
        for table in section.tables:
            write_atomically(out / TABLES / f"{table.name}.csv", to_csv(table).encode())
    return out / "report.html"


def rate_tracks(evidence: Evidence) -> dict[str, list[Rating]]:
    """Ratings per track from duels and mixed fields together."""
    rated = {}
    for track in evidence.scale.tracks:
        results = [result for (where, _), met in evidence.meetings.items() if where == track for result in met]
        seeds = sorted({result.seed for result in results})
        rated[track] = rate([[result for result in results if result.seed == seed] for seed in seeds])
    return rated


def make_report(evidence: Evidence) -> Report:
    """Everything the evidence says."""
    ratings = rate_tracks(evidence)
    figures = {name: tuple(map(_picture, drawings)) for name, drawings in all_figures(evidence, ratings).items()}
    tables = {table.name: table for table in all_tables(evidence, ratings)}
    performance = tuple(table for name, table in tables.items() if name.startswith("performance-"))
    ingredients = tuple(tables[name] for name in ("ablations", "trials") if name in tables)
    return Report(
        title="CRUISE reproduced",
        lead=headline(evidence, ratings),
        warnings=warnings(evidence),
        sections=(
            Section("At a glance", (RACES,), _glossary(), figures["overview"], (claims_table(evidence),)),
            Section("What did not reproduce, and why", points=reasons(evidence)),
            Section("The paper's two tables", (f"Printed figures: {PAPER}.",), tables=performance),
            Section(
                "Who wins against whom", pictures=figures["meetings"], tables=(tables["duels"], tables["mixed-fields"])
            ),
            Section("What each ingredient does", pictures=figures["ablations"], tables=ingredients),
            Section("After every stage", pictures=figures["stages"], tables=(tables["stages"],)),
            Section("Learning curves", pictures=figures["curves"]),
            Section("Trajectories", () if figures["paths"] else (NO_RACE,), pictures=figures["paths"]),
            Section("How far from the fastest possible lap", pictures=figures["limits"], tables=(tables["limits"],)),
            Section("How to make it again", (_how(),), tables=(tables["runs"],)),
        ),
    )


def _picture(drawing: Drawing) -> Picture:
    return Picture(drawing.name, drawing.caption, to_svg(drawing.figure))


def _glossary() -> tuple[Point, ...]:
    """Who flies, for somebody who has not read the paper."""
    kinds = ("cruise", "vanilla", "self-play-only", "se-ibr", "se-ibr-tuned")
    return tuple(Point(f"{KINDS[kind].title}:", f"{KINDS[kind].summary}.") for kind in kinds)


def _how() -> str:
    return (
        "`cruise reproduce` runs everything again and goes on where it was stopped, `cruise reproduce --report-only "
        "--out DIR` makes this report from the results that are kept. Every row names what made it. Two drones learn "
        "faster, with wider noise and fewer races at once than three and four, in every kind of training alike."
    )


def warnings(evidence: Evidence) -> tuple[str, ...]:
    """What a reader must know of the results as a whole: their scale, what is missing, what does not go together."""
    told = []
    if evidence.scale.name != "full":
        told.append(f"{scale_note(evidence).strip()} Its policies have hardly learned: it shows that everything works.")
    planned = make_plan(evidence.scale)
    there = {(cell.kind, cell.track, cell.drones, cell.seed) for cell in evidence.all_cells}
    there |= {("head-to-head", m.track, m.drones, m.seed) for met in evidence.meetings.values() for m in met}
    missing = sum((job.kind, job.track, job.drones, job.seed) not in there for job in planned)
    if missing:
        told.append(f'{missing} of {len(planned)} planned results are not there yet; they show as "not run".')
    for kind in mixed_settings(evidence):
        told.append(f"The cells of {KINDS[kind].title} were made with different settings; see their files.")
    return tuple(told)
