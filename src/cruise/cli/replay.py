"""`cruise replay`: race logs as a page that replays them in three dimensions."""

import functools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from cruise.cli.line_up import described
from cruise.cli.outputs import Films, Product, check_output, name, show, write
from cruise.errors import CruiseError


@dataclass(frozen=True)
class Replay:
    """Replay race logs in the browser."""

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, described("RACE.npz")]
    """Race logs, from `cruise race --log`; the page steps through several."""
    html: Annotated[Path | None, described("FILE")] = None
    """Where to write the page. By default beside the first log, under its name."""
    ghost: Annotated[Path | None, described("RACE.npz")] = None
    """A log on the same track whose drones fly along, translucent and out of competition."""
    films: Films = field(default_factory=Films)
    open: bool = False
    """Show the page in the browser, where there is a display."""

    def run(self) -> int:
        """Read and check the logs, write the page, name it."""
        if not self.logs:
            raise CruiseError("name at least one race log, as cruise race --log race.npz writes it")
        page = self.html or self.logs[0].with_suffix(".html")
        check_output("--html", page, ".html")
        self.films.check()
        from cruise.storage.race_log import load_race_log  # noqa: PLC0415  (imports NumPy)
        from cruise.viewer.page import replay_page  # noqa: PLC0415

        logs = [load_race_log(path) for path in self.logs]
        ghost = None if self.ghost is None else load_race_log(self.ghost)
        labels = [path.stem for path in self.logs]
        replay = Product("replay", page, functools.partial(replay_page, logs, labels, ghost))
        products = [replay, *self.films.products(logs[0])]
        write(products)
        name(products)
        if self.open:
            show(page)
        return 0
