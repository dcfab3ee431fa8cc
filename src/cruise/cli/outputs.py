"""What `cruise race` and `cruise replay` leave on disk, and how a page is shown."""

import functools
import os
import sys
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import tyro

from cruise.cli.line_up import described
from cruise.errors import CruiseError

if TYPE_CHECKING:
    from cruise.storage.race_log import RaceLog


class Product(NamedTuple):
    """A file to be written."""

    name: str
    path: Path
    make: Callable[[], bytes]


@dataclass(frozen=True)
class Outputs:
    """Files that show and hold races."""

    png: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = Path("race.png")
    """Where to draw the race. `--png None` draws nothing."""
    html: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = Path("race.html")
    """Where to write the 3-D replay, a page for any browser. `--html None` writes none."""
    log: Annotated[Path | None, described("FILE")] = None
    """Where to write the race log (.npz; docs/race-log.md describes it). Several are numbered: race-1.npz ..."""
    open: bool = False
    """Show the replay in the browser, where there is a display."""

    def check(self) -> None:
        """Raises CruiseError where a file cannot be meant, before anything is flown for it."""
        check_output("--png", self.png, ".png")
        check_output("--html", self.html, ".html")
        check_output("--log", self.log, ".npz")
        if self.open and self.html is None:
            raise CruiseError("--open shows the replay: leave --html as it is, or name a .html file")

    def write(self, logs: Sequence["RaceLog"], labels: Sequence[str]) -> list[Product]:
        """Write everything that was asked for, once all of it is made."""
        products = self._products(logs, labels)
        contents = [product.make() for product in products]
        from cruise.storage.atomic import write_atomically  # noqa: PLC0415  (imports NumPy)

        for product, content in zip(products, contents, strict=True):
            write_atomically(product.path, content)
        return products

    def tell(self, products: Sequence[Product]) -> None:
        """Say where everything is, and show the replay if asked to."""
        for product in products:
            print(f"{product.name:8} {product.path}")
        if self.open and self.html is not None:
            show(self.html)

    def _products(self, logs: Sequence["RaceLog"], labels: Sequence[str]) -> list[Product]:
        """Logs first, which cannot be made again from the others. Pictures show the first race."""
        from cruise.report.race_figure import draw_race  # noqa: PLC0415  (imports Matplotlib)
        from cruise.viewer.page import replay_page  # noqa: PLC0415

        paths = numbered(self.log, len(logs))
        products = [Product("log", path, log.to_bytes) for path, log in zip(paths, logs, strict=False)]
        if self.png is not None:
            products.append(Product("picture", self.png, functools.partial(draw_race, logs[0])))
        if self.html is not None:
            products.append(Product("replay", self.html, functools.partial(replay_page, logs, labels)))
        return products


def check_output(flag: str, path: Path | None, ending: str) -> None:
    """Raises CruiseError where a file cannot be meant, before anything is flown for it."""
    if path is None:
        return
    if path.suffix != ending:
        raise CruiseError(f"{flag} must name a {ending} file, got {str(path)!r}")
    if path.is_dir():
        raise CruiseError(f"{flag} {path} is a folder")


def numbered(path: Path | None, count: int) -> list[Path]:
    """One path, or `count` with a number each; none for None."""
    if path is None:
        return []
    return [path] if count == 1 else [path.with_stem(f"{path.stem}-{k}") for k in range(1, count + 1)]


def show(page: Path | str) -> None:
    """Open a page, a file or an address, in the browser; where there is no display, leave it at having named it."""
    if has_display():
        webbrowser.open(page if isinstance(page, str) else page.resolve().as_uri())


def has_display() -> bool:
    """Whether a window can be seen."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
