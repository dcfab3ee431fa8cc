"""`cruise reproduce` and `cruise sweep`: the paper's experiments run again, one after the other or many at once."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.table import Column, Table

from cruise.cli.compilation import prepare_training, start_jax
from cruise.cli.console import make_console
from cruise.cli.line_up import described
from cruise.errors import CruiseError
from experiments.evidence import read_evidence
from experiments.plan import Job, choose, full_scale, make_plan, quick_scale
from experiments.progress import show_events
from experiments.report import write_report
from experiments.results import ResultFolder
from experiments.study import left, run_jobs, state_of
from experiments.sweep import Cluster, sweep
from experiments.work import Work

FULL, QUICK = Path("runs/reproduce"), Path("runs/reproduce-quick")
MAX_SEEDS = 100


@dataclass(frozen=True)
class Study:
    """What `cruise reproduce` and `cruise sweep` have in common: which jobs, and where they lie."""

    quick: bool = False
    """A look at everything in minutes, with a fiftieth of the training steps, in folders of its own."""
    only: Annotated[tuple[str, ...], described("WORD ...")] = ()
    """Run these alone: kinds, tracks, numbers of drones, seeds (`--only cruise ring 4 s0`)."""
    seeds: int = 3
    """Training seeds of every cell; --quick has one."""
    results: Annotated[Path | None, described("DIR")] = None
    """Where results are kept: results, with --quick runs/reproduce-quick/results."""
    work: Annotated[Path | None, described("DIR")] = None
    """Where training runs lie: runs/reproduce, with --quick runs/reproduce-quick."""

    def plan(self) -> tuple[Work, tuple[Job, ...]]:
        """The study on disk, and the jobs that are meant. Raises CruiseError for flags that fit nothing."""
        if not 1 <= self.seeds <= MAX_SEEDS:
            raise CruiseError(f"--seeds must be between 1 and {MAX_SEEDS}, not {self.seeds}")
        scale = quick_scale() if self.quick else full_scale(self.seeds)
        folder, results = (QUICK, QUICK / "results") if self.quick else (FULL, Path("results"))
        work = Work(scale, ResultFolder(self.results or results), self.work or folder)
        return work, choose(make_plan(scale), self.only)


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

    def _run_jobs(self, work: Work, jobs: tuple[Job, ...]) -> int:
        start_jax()
        wanted = left(work, jobs, self.again)
        return show_events(make_console(), run_jobs(work, wanted), wanted, len(jobs))

    def _report(self, work: Work) -> None:
        evidence = read_evidence(work.results, work.scale)
        page = write_report(evidence, self.out or work.folder / "report")
        print(f"report {page} from {sum(1 for _ in evidence.all_cells)} cells")


@dataclass(frozen=True)
class Sweep(Study):
    """Run many jobs of `cruise reproduce` at once through Ray. Stop it with Ctrl-C; the same command goes on."""

    address: Annotated[str | None, described("HOST:PORT")] = None
    """The head of a Ray cluster, or `auto`. By default this machine alone. All must see --results and --work."""
    cores: Annotated[int | None, described("N")] = None
    """Cores for each job, which keeps to them; as many jobs run at once as there are cores for. By default each has its
    share of all cores: one, where jobs are many."""

    def run(self) -> int:
        """Run what is left of the plan."""
        work, jobs = self.plan()
        wanted = left(work, jobs)
        events = sweep(work, wanted, Cluster(self.address, self.cores), prepare_training)
        return show_events(make_console(), events, wanted, len(jobs))


def show_states(work: Work, jobs: tuple[Job, ...]) -> int:
    """Print a table of jobs by kind, track and drones, every seed with its state, and a count."""
    states: dict[Job, str] = {job: state_of(work, job) for job in jobs}
    rows: dict[tuple[str, str, str], list[str]] = {}
    for job, state in states.items():
        rows.setdefault((job.kind, job.track, str(job.drones)), []).append(f"s{job.seed} {state}")
    table = Table("kind", "track", Column("drones", justify="right"), "seeds")
    for row, seeds in rows.items():
        table.add_row(*row, ", ".join(seeds))
    make_console().print(table)
    print(", ".join(f"{count} {state}" for state, count in Counter(states.values()).items()))
    return 0
