"""`cruise reproduce`: the paper's experiments run again, and the report of what came out."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.console import Console
from rich.table import Column, Table

from cruise.cli.compilation import prepare_training
from cruise.cli.line_up import described
from cruise.cli.study import Study
from cruise.errors import CruiseError

if TYPE_CHECKING:
    from cruise.reproduction.plan import Job
    from cruise.reproduction.work import Work


@dataclass(frozen=True)
class Reproduce(Study):
    """Run the paper's experiments again and write a report. Stop it with Ctrl-C; the same command goes on."""

    list: bool = False
    """Show what is done and what is left, and run nothing."""
    report_only: bool = False
    """Write the report from the results there are, and run nothing."""
    again: bool = False
    """Run anew what was made with other settings than today's, or whose file is broken."""
    out: Annotated[Path | None, described("DIR")] = None
    """Where report.html, report.md, figures and CSV files go: the folder `report` below --work."""

    def run(self) -> int:
        """Run what is left of the plan, then write the report."""
        if self.list + self.report_only + self.again > 1:
            raise CruiseError("--list, --report-only and --again exclude each other")
        prepare_training()
        work, jobs = self.plan()
        if self.report_only and not work.results.path.is_dir():
            raise CruiseError(f"no results in {work.results.path}: name their folder with --results, or run some first")
        if self.list:
            return show_states(work, jobs)
        failed = 0 if self.report_only else self._run_jobs(work, jobs)
        self._report(work)
        return failed

    def _run_jobs(self, work: "Work", jobs: "tuple[Job, ...]") -> int:
        from cruise.cli.reproduce_progress import show_events  # noqa: PLC0415
        from cruise.reproduction.study import left, run_jobs  # noqa: PLC0415

        wanted = left(work, jobs, self.again)
        return show_events(Console(), run_jobs(work, wanted), wanted, len(jobs))

    def _report(self, work: "Work") -> None:
        from cruise.reproduction.assemble import write_report  # noqa: PLC0415
        from cruise.reproduction.evidence import read_evidence  # noqa: PLC0415

        evidence = read_evidence(work.results, work.scale)
        page = write_report(evidence, self.out or work.folder / "report")
        print(f"report {page} from {sum(1 for _ in evidence.all_cells)} cells")


def show_states(work: "Work", jobs: "tuple[Job, ...]") -> int:
    """Print a table of jobs by kind, track and drones, every seed with its state, and a count."""
    from cruise.reproduction.study import state_of  # noqa: PLC0415

    states: dict[Job, str] = {job: state_of(work, job) for job in jobs}
    rows: dict[tuple[str, str, str], list[str]] = {}
    for job, state in states.items():
        rows.setdefault((job.kind, job.track, str(job.drones)), []).append(f"s{job.seed} {state}")
    table = Table("kind", "track", Column("drones", justify="right"), "seeds")
    for row, seeds in rows.items():
        table.add_row(*row, ", ".join(seeds))
    Console().print(table)
    print(", ".join(f"{count} {state}" for state, count in Counter(states.values()).items()))
    return 0
