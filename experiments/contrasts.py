"""Two kinds of pilot compared, in words that the numbers choose."""

from collections.abc import Sequence
from dataclasses import dataclass

from experiments.evidence import Evidence
from experiments.pooling import Pooled, Summary, Verdict, compare

NOT_YET = "Not run yet."


@dataclass(frozen=True)
class Contrast:
    """A kind with an ingredient and one without, on one track."""

    track: str
    drones: int
    with_it: Summary
    without: Summary

    @property
    def success(self) -> Verdict:
        """Of the one with the ingredient, compared with the other."""
        return compare(self.with_it.success, self.without.success)

    @property
    def lap(self) -> Verdict:
        """Of the timed flying lap; "lower" is better."""
        return compare(self.with_it.lap, self.without.lap)


def contrasts(evidence: Evidence, with_it: str, without: str, drones: int) -> list[Contrast]:
    """On every track on which both were run."""
    found = []
    for track in evidence.scale.tracks:
        pair = evidence.summary(with_it, track, drones), evidence.summary(without, track, drones)
        if pair[0] and pair[1]:
            found.append(Contrast(track, drones, pair[0], pair[1]))
    return found


def verdict(found: Sequence[Contrast]) -> str:
    """Whether the ingredient matters, and how. Only differences whose intervals do not overlap count."""
    if not found:
        return "Not known yet."
    success, lap = {c.success for c in found}, {c.lap for c in found}
    differences = {
        "more drones finish with it": "higher" in success,
        "fewer drones finish with it": "lower" in success,
        "it makes laps shorter": "lower" in lap,
        "it makes laps longer": "higher" in lap,
    }
    told = [what for what, is_so in differences.items() if is_so]
    return f"Yes: {' and '.join(told)}." if told else "No difference that these runs can show."


def in_words(contrast: Contrast) -> str:
    """What was measured with and without, and whether the difference is more than chance."""
    one, other = contrast.with_it, contrast.without
    finished = f"{percent(one.success)} of the drones finish with it, {percent(other.success)} without"
    told = f"on the {contrast.track} {finished} ({_told(contrast.success)})"
    if not (one.lap.known and other.lap.known):
        return told
    return f"{told}, in laps of {one.lap.mean:.2f} and {other.lap.mean:.2f} s ({_told(contrast.lap)})"


def _told(found: Verdict) -> str:
    return "intervals overlap" if found == "not told apart" else "intervals apart"


def sentence(found: Sequence[Contrast]) -> str:
    """All tracks in one sentence."""
    text = "; ".join(map(in_words, found))
    return f"With {found[0].drones} drones, {text}." if found else NOT_YET


def outcome(summary: Summary) -> str:
    """Who finishes and how fast, in a phrase."""
    lap = f" in laps of {summary.lap.mean:.2f} s" if summary.lap.known else ""
    return f"{percent(summary.success)} of the drones finish{lap}"


def percent(pooled: Pooled) -> str:
    """A rate for people; nothing but all is called 100 %, nothing but none 0 %."""
    value = 100 * pooled.mean
    return f"{value:.0f} %" if value in (0.0, 100.0) else f"{min(max(value, 0.1), 99.9):.1f} %"


def capital(text: str) -> str:
    """As the beginning of a sentence."""
    return text[:1].upper() + text[1:]
