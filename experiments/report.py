"""The report put together and written: report.html, report.md, figures and CSV files."""

from pathlib import Path

from cruise.storage.atomic import write_atomically
from experiments.entries import scale_note
from experiments.evidence import Evidence, mixed_settings
from experiments.figures import all_figures
from experiments.figures.style import to_svg
from experiments.named import named
from experiments.page import Content, read_blocks, to_page, to_text
from experiments.plan import KINDS, make_plan
from experiments.ratings import Rating, rate
from experiments.table import to_csv
from experiments.tables import all_tables

FIGURES, TABLES = "figures", "tables"  # folders beside report.html and report.md


def write_report(evidence: Evidence, out: Path) -> Path:
    """Write the report of the evidence, the same for the same evidence, and give the path of its page."""
    blocks, content = read_blocks(), make_content(evidence)
    write_atomically(out / "report.html", to_page(blocks, content).encode())
    write_atomically(out / "report.md", to_text(blocks, content).encode())
    for name, svg in content.figures.items():
        write_atomically(out / FIGURES / f"{name}.svg", svg.encode())
    for name, table in content.tables.items():
        write_atomically(out / TABLES / f"{name}.csv", to_csv(table).encode())
    return out / "report.html"


def make_content(evidence: Evidence) -> Content:
    """Everything the evidence says."""
    ratings = rate_tracks(evidence)
    return Content(
        values=named(evidence, ratings),
        tables={table.name: table for table in all_tables(evidence, ratings)},
        figures={name: to_svg(figure) for name, figure in all_figures(evidence, ratings).items()},
        warnings=warnings(evidence),
    )


def rate_tracks(evidence: Evidence) -> dict[str, list[Rating]]:
    """Ratings per track from duels and mixed fields together."""
    rated = {}
    for track in evidence.scale.tracks:
        results = [result for (where, _), met in evidence.meetings.items() if where == track for result in met]
        seeds = sorted({result.seed for result in results})
        rated[track] = rate([[result for result in results if result.seed == seed] for seed in seeds])
    return rated


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
