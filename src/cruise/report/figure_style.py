"""One look for all figures of a report: colours of methods, axes, and how a figure becomes SVG."""

import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Style = dict[str, Any]

INK, FAINT, GRID = "#222222", "#8a8a8a", "#e6e6e6"
# Okabe and Ito's colours, distinct to colour-blind eyes; markers tell series apart in black and white.
BLUE, ORANGE, GREEN, PINK, SKY, VERMILION, BLACK = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#D55E00",
    "#000000",
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
RC: Any = {  # its stub knows literal keys alone
    "font.size": 10.0,
    "axes.edgecolor": "#666666",
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "svg.hashsalt": "cruise",  # the same figure gives the same file
    "svg.fonttype": "path",
}


def new_figure(width: float, height: float) -> Figure:
    """A white figure of so many inches."""
    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def to_svg(figure: Figure) -> str:
    """The figure as SVG text, the same for the same figure."""
    buffer = io.StringIO()
    with mpl.rc_context(RC):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def to_png(figure: Figure) -> bytes:
    """The figure as a PNG picture, the same for the same figure."""
    buffer = io.BytesIO()
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
