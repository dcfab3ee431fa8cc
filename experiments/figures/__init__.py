"""Figures of the report."""

from matplotlib.figure import Figure

from cruise.report.figure_style import our_look
from experiments.evidence import Evidence
from experiments.figures.comparison import limits, overview
from experiments.figures.curves import curves
from experiments.figures.duels import duels
from experiments.figures.listings import ablations, ratings_figure
from experiments.figures.paths import paths
from experiments.figures.stages import stages
from experiments.ratings import Rating


@our_look()
def all_figures(evidence: Evidence, ratings: dict[str, list[Rating]]) -> dict[str, Figure]:
    """By name."""
    return {
        "overview": overview(evidence),
        "stages": stages(evidence),
        "learning-curves": curves(evidence),
        "ablations": ablations(evidence),
        "duels": duels(evidence),
        "ratings": ratings_figure(evidence, ratings),
        "limits": limits(evidence),
        **paths(evidence),
    }
