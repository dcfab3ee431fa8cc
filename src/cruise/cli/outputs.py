"""What `cruise race` and `cruise replay` leave on disk, and how a page is shown."""

import functools
import os
import sys
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
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
class Films:
    """A race as an animated picture or a film."""

    gif: Annotated[Path | None, described("FILE")] = None
    """Where to write the race, the first of several, as an animated picture (.gif)."""
    mp4: Annotated[Path | None, described("FILE")] = None
    """Where to write it as a film (.mp4); needs the extra `video`."""
    clip: Annotated[tuple[float, float] | None, described("FROM TO")] = None
    """Which seconds of the race they show. By default all."""

    def check(self) -> None:
        """Raises CruiseError where a file cannot be meant or made, before anything is flown for it."""
        check_output("--gif", self.gif, ".gif")
        check_output("--mp4", self.mp4, ".mp4")
        if self.clip is not None and not 0 <= self.clip[0] < self.clip[1]:
            raise CruiseError(
                f"--clip takes two times in seconds, the earlier first, got {self.clip[0]} {self.clip[1]}"
            )
        if self.mp4 is not None:
            from cruise.viewer.film.files import check_video  # noqa: PLC0415  (imports SciPy)

            check_video()

    def products(self, log: "RaceLog") -> list[Product]:
        """The files asked for."""
        if self.gif is None and self.mp4 is None:
            return []
        from cruise.viewer.film.files import draw_gif, draw_mp4  # noqa: PLC0415

        makers = ((self.gif, draw_gif), (self.mp4, draw_mp4))
        return [Product("film", path, functools.partial(draw, log, self.clip)) for path, draw in makers if path]


@dataclass(frozen=True)
class Outputs:
    """Files that show and hold races."""

    png: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = Path("race.png")
    """Where to draw the race. `--png None` draws nothing."""
    html: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = Path("race.html")
    """Where to write the 3-D replay, a page for any browser. `--html None` writes none."""
    films: Films = field(default_factory=Films)
    log: Annotated[Path | None, described("FILE")] = None
    """Where to write the race log (.npz; docs/race-log.md describes it). Several are numbered: race-1.npz ..."""
    open: bool = False
    """Show the replay in the browser, where there is a display."""

    def check(self) -> None:
        """Raises CruiseError where a file cannot be meant, before anything is flown for it."""
        check_output("--png", self.png, ".png")
        check_output("--html", self.html, ".html")
        check_output("--log", self.log, ".npz")
        self.films.check()
        if self.open and self.html is None:
            raise CruiseError("--open shows the replay: leave --html as it is, or name a .html file")

    def write(self, logs: Sequence["RaceLog"], labels: Sequence[str]) -> list[Product]:
        """Write everything that was asked for."""
        products = self._products(logs, labels)
        write(products)
        return products

    def tell(self, products: Sequence[Product]) -> None:
        """Say where everything is, and show the replay if asked to."""
        name(products)
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
        return products + self.films.products(logs[0])


def write(products: Sequence[Product]) -> None:
    """Make everything, then write it: where something cannot be made, nothing is written."""
    from cruise.storage.atomic import write_atomically  # noqa: PLC0415  (imports NumPy)

    contents = [product.make() for product in products]
    for product, content in zip(products, contents, strict=True):
        write_atomically(product.path, content)


def name(products: Sequence[Product]) -> None:
    """Say where everything is."""
    for product in products:
        print(f"{product.name:8} {product.path}")


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
