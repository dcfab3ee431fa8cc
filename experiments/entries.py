"""What the entries and notes of all the report's tables share."""

from experiments.evidence import Evidence
from experiments.pooling import Pooled, Summary
from experiments.table import Entry, Number

NOT_RUN = "not run"
INTERVALS = (
    "Mean and, in brackets or small, 95 % interval over training seeds (over evaluation seeds for the planner); where "
    "there is one seed alone, over its races."
)


def number(pooled: Pooled | None, factor: float = 1.0, digits: int = 2) -> Entry:
    """A pooled quantity as a table shows it."""
    if pooled is None:
        return NOT_RUN
    return Number(factor * pooled.mean, factor * pooled.low, factor * pooled.high, digits)


def quantity(summary: Summary | None, name: str, factor: float = 1.0, digits: int = 2) -> Entry:
    """One of a summary's quantities."""
    return number(None if summary is None else getattr(summary, name), factor, digits)


def seeds(summary: Summary | None) -> str:
    """How many a summary is over."""
    return str(len(summary.seeds)) if summary else "0"


def note(evidence: Evidence, text: str) -> str:
    """A table's note, which begins with what every table says of a run that is not the full one."""
    return scale_note(evidence) + text


def scale_note(evidence: Evidence) -> str:
    """The scale of a run that is not the full one; "" of the full one."""
    scale = evidence.scale
    if scale.name == "full":
        return ""
    return f"Quick run: {scale.steps / 1e6:g} M training steps instead of 40 M, {scale.races} races, one seed. "
