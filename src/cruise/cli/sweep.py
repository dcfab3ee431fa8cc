"""`cruise sweep`: many jobs of the reproduction at once, through Ray."""

from dataclasses import dataclass
from typing import Annotated

from rich.console import Console

from cruise.cli.compilation import prepare_training
from cruise.cli.line_up import described
from cruise.cli.study import Study


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
        from cruise.cli.reproduce_progress import show_events  # noqa: PLC0415  (imports JAX, as the next two do)
        from cruise.reproduction.study import left  # noqa: PLC0415
        from cruise.reproduction.sweep import Cluster, sweep  # noqa: PLC0415

        wanted = left(work, jobs)
        events = sweep(work, wanted, Cluster(self.address, self.cores), prepare_training)
        return show_events(Console(), events, wanted, len(jobs))
