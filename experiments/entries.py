"""How numbers of the report are written, in tables and in text."""

from experiments.evidence import Evidence
from experiments.pooling import Pooled, Summary
from experiments.table import Entry, Number

NOT_RUN = "not run"


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


def scale_note(evidence: Evidence) -> str:
    """The scale of a run that is not the full one; "" of the full one."""
    scale = evidence.scale
    if scale.name == "full":
        return ""
    return f"Quick run: {scale.steps / 1e6:g} M training steps instead of 40 M, {scale.races} races, one seed. "


def percent(pooled: Pooled) -> str:
    """A rate for people; nothing but all is called 100 %, nothing but none 0 %."""
    value = 100 * pooled.mean
    return f"{value:.0f} %" if value in (0.0, 100.0) else f"{min(max(value, 0.1), 99.9):.1f} %"
