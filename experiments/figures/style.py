"""What the report's figures share: what is measured, colours of kinds of pilots, rows and columns of panels."""

import io
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from cruise.palette import BLACK, BLUE, GREEN, ORANGE, PINK, SKY, VERMILION
from cruise.report.figure_style import new_figure, our_look
from experiments.evidence import Evidence
from experiments.pooling import Pooled
from experiments.printed import TABLES

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
COLOURS = {
    "cruise": BLUE,
    "vanilla": ORANGE,
    "se-ibr": GREEN,
    "se-ibr-tuned": VERMILION,
    "self-play-only": PINK,
    "vanilla-stage5": "#B0771C",
    "curriculum-only": SKY,
    "self-play-after": BLACK,
    "copies-only": "#3B7A3B",
    "paper-reward": "#7A7A7A",
    "paper-observation": "#8C6BB1",
}
DRONE_COLOURS = {2: BLUE, 3: ORANGE, 4: GREEN}


class Quantity(NamedTuple):
    """A field of `Summary`, and how it is shown."""

    name: str
    label: str
    factor: float = 1.0

    @property
    def title(self) -> str:
        """Without the unit."""
        return self.label.partition(" [")[0]

    def of(self, evidence: Evidence, kind: str, track: str, drones: int) -> Pooled | None:
        """As shown; None where nothing was observed."""
        summary = evidence.summary(kind, track, drones)
        pooled: Pooled | None = getattr(summary, self.name) if summary else None
        return pooled.times(self.factor) if pooled and pooled.known else None

    def printed(self, kind: str, track: str, drones: int) -> float | None:
        """What the paper prints; nobody has printed a timed lap."""
        return None if self is LAP else getattr(TABLES.get((track, kind, drones)), self.name, None)


SUCCESS = Quantity("success", "finished, per drone [%]", 100.0)
SPEED = Quantity("speed", "mean speed [m/s]")
LAP = Quantity("lap", "timed flying lap [s]")


def panels(width: float, height: float, shape: tuple[int, int], **sharing: Any) -> tuple[Figure, np.ndarray]:
    """A figure of so many inches with rows and columns of axes."""
    figure = new_figure(width, height)
    return figure, figure.subplots(*shape, squeeze=False, **sharing)


def to_svg(figure: Figure) -> str:
    """The figure as SVG text, the same for the same figure."""
    buffer = io.StringIO()
    with our_look(), mpl.rc_context({"svg.hashsalt": "cruise", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()
