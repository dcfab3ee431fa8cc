"""One look for all figures: axes, letters, and how a figure becomes a PNG picture.

A figure is built and written inside `our_look`: the settings of the user's own matplotlibrc do not reach it, and
the names that people gave to tracks and pilots are written as they are: to Matplotlib "$...$" is a formula.
"""

import contextlib
import io
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.palette import BLACK, BLUE, FAINT, GREEN, GRID, INK, ORANGE, PINK, SKY, VERMILION

__all__ = ["BLACK", "BLUE", "FAINT", "GREEN", "GRID", "INK", "ORANGE", "PINK", "SKY", "VERMILION"]

Style = dict[str, Any]

RC: Any = {  # its stub knows literal keys alone
    "font.size": 10.0,
    "axes.edgecolor": "#666666",
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.parse_math": False,
}


@contextlib.contextmanager
def our_look() -> Iterator[None]:
    """Matplotlib as it comes, with `RC`; also a decorator. Artists keep what was set when they were made."""
    with mpl.style.context(["default", RC]), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)  # drawn as a box, and that is all
        yield


def new_figure(width: float, height: float) -> Figure:
    """A white figure of so many inches."""
    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def to_png(figure: Figure) -> bytes:
    """The figure as a PNG picture, the same for the same figure."""
    buffer = io.BytesIO()
    with our_look():
        figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def tidy(axes: Axes, title: str = "", xlabel: str = "", ylabel: str = "") -> None:
    """Title, labels and a quiet grid."""
    axes.set_title(title, loc="left", fontsize=11, color=INK)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def legend_below(figure: Figure, axes: Sequence[Axes], columns: int = 5) -> None:
    """One legend for all panels, every label once, under the figure."""
    found = {label: handle for panel in axes for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    if found:
        figure.legend(
            list(found.values()), list(found), loc="outside lower center", ncols=columns, frameon=False, fontsize=9
        )
