"""Which jobs of the reproduction, and where they lie: what `cruise reproduce` and `cruise sweep` have in common."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cruise.cli.line_up import described
from cruise.errors import CruiseError

if TYPE_CHECKING:
    from cruise.reproduction.plan import Job
    from cruise.reproduction.work import Work

FULL, QUICK = Path("runs/reproduce"), Path("runs/reproduce-quick")
MAX_SEEDS = 100


@dataclass(frozen=True)
class Study:
    """Jobs of the reproduction, chosen by flags."""

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

    def plan(self) -> "tuple[Work, tuple[Job, ...]]":
        """The study on disk, and the jobs that are meant. Raises CruiseError for flags that fit nothing."""
        if not 1 <= self.seeds <= MAX_SEEDS:
            raise CruiseError(f"--seeds must be between 1 and {MAX_SEEDS}, not {self.seeds}")
        from cruise.reproduction.plan import choose, full_scale, make_plan, quick_scale  # noqa: PLC0415  (JAX, also next)
        from cruise.reproduction.results import ResultFolder  # noqa: PLC0415
        from cruise.reproduction.work import Work  # noqa: PLC0415

        scale = quick_scale() if self.quick else full_scale(self.seeds)
        folder, results = (QUICK, QUICK / "results") if self.quick else (FULL, Path("results"))
        work = Work(scale, ResultFolder(self.results or results), self.work or folder)
        return work, choose(make_plan(scale), self.only)
