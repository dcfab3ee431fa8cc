"""`cruise sweep`: many jobs of the reproduction at once, through Ray."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.console import Console

from cruise.cli.compilation import prepare_training
from cruise.cli.line_up import described
from cruise.cli.reproduce import MAX_SEEDS, study
from cruise.errors import CruiseError


@dataclass(frozen=True)
class Sweep:
    """Run many jobs of `cruise reproduce` at once through Ray. Stop it with Ctrl-C; the same command goes on."""

    only: Annotated[tuple[str, ...], described("WORD ...")] = ()
    """Run these alone: kinds, tracks, numbers of drones, seeds (`--only cruise ring 4 s0`)."""
    seeds: int = 3
    """Training seeds of every cell; --quick has one."""
    quick: bool = False
    """With a fiftieth of the training steps, in folders of its own."""
    address: Annotated[str | None, described("HOST:PORT")] = None
    """The head of a Ray cluster, or `auto`. By default this machine alone. All machines must see the folders below."""
    cores: Annotated[int | None, described("N")] = None
    """Cores for each job; as many jobs run at once as there are cores for. By default all of a machine."""
    results: Annotated[Path | None, described("DIR")] = None
    """Where results are kept: results, with --quick runs/reproduce-quick/results."""
    work: Annotated[Path | None, described("DIR")] = None
    """Where training runs lie: runs/reproduce, with --quick runs/reproduce-quick."""

    def run(self) -> int:
        """Run what is left of the plan."""
        if not 1 <= self.seeds <= MAX_SEEDS:
            raise CruiseError(f"--seeds must be between 1 and {MAX_SEEDS}, not {self.seeds}")
        from cruise.cli.reproduce_progress import show_events  # noqa: PLC0415  (imports JAX, as the next three do)
        from cruise.reproduction.plan import choose, full_scale, make_plan, quick_scale  # noqa: PLC0415
        from cruise.reproduction.study import left  # noqa: PLC0415
        from cruise.reproduction.sweep import Cluster, sweep  # noqa: PLC0415

        scale = quick_scale() if self.quick else full_scale(self.seeds)
        work = study(scale, self.results, self.work)
        jobs = choose(make_plan(scale), self.only)
        wanted = left(work, jobs)
        events = sweep(work, wanted, Cluster(self.address, self.cores), prepare_training)
        try:
            return show_events(Console(), events, wanted, len(jobs))
        except KeyboardInterrupt:
            raise KeyboardInterrupt("stopped; what is done is kept, and the same command goes on") from None
