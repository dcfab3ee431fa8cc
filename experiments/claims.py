"""What the paper claims and what the report's page says, each held against the results, place by place."""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

from experiments.entries import NOT_RUN, percent, scale_note
from experiments.evidence import Evidence
from experiments.plan import DUEL, KINDS
from experiments.pooling import Summary
from experiments.printed import FREE, SPEED_FACTOR, TABLES
from experiments.ratings import win_rate
from experiments.table import Table

FAILED = 0.05  # a success rate up to this is called a failure
HALF = 0.5


class Finding(NamedTuple):
    """What was measured at a place, and whether the claim holds there."""

    told: str
    holds: bool


Findings = dict[str, Finding]  # by place: a track, or a track and drones (ring-4)


class Claim(NamedTuple):
    """Something that results can decide."""

    text: str
    printed: str  # what the paper says
    findings: Callable[[Evidence], Findings]


def verdict(findings: Findings) -> str:
    """Whether a claim holds."""
    held = sum(finding.holds for finding in findings.values())
    return NOT_RUN if not findings else "yes" if held == len(findings) else "in part" if held else "no"


def claims_table(evidence: Evidence) -> Table:
    """Every claim; in brackets the places at which it does not hold."""
    rows = []
    for claim in CLAIMS.values():
        found = claim.findings(evidence)
        told = [f"{place}: {f.told}" if f.holds else f"({place}: {f.told})" for place, f in found.items()]
        rows.append((claim.text, claim.printed, ", ".join(told) or NOT_RUN, verdict(found)))
    header = ("claim", "printed", "measured", "holds here")
    return Table("claims", "The paper's claims, checked", header, tuple(rows), scale_note(evidence))


def _run(evidence: Evidence, kind: str) -> Iterator[tuple[str, int, Summary]]:
    """Tracks and drones at which a kind was run."""
    for track in evidence.scale.tracks:
        for drones in evidence.scale.drones:
            if summary := evidence.summary(kind, track, drones):
                yield track, drones, summary


def _fast(evidence: Evidence) -> Findings:
    found = {}
    for track, drones, summary in _run(evidence, "cruise"):
        mean, printed = summary.speed.mean, TABLES[track, "cruise", drones].speed or math.nan
        told = f"{mean:.2f} m/s" if summary.speed.known else "nobody finished"
        found[f"{track}-{drones}"] = Finding(told, round(mean, 1) >= printed)
    return found


def _safe(evidence: Evidence) -> Findings:
    return {
        f"{track}-{drones}": Finding(
            f"{100 * summary.success.mean:.2f} of {TABLES[track, 'cruise', drones].success:g} %",
            round(100 * summary.success.mean, 1) >= TABLES[track, "cruise", drones].success,
        )
        for track, drones, summary in _run(evidence, "cruise")
    }


def factors(evidence: Evidence, planner: str) -> dict[str, float]:
    """CRUISE's mean speed over the planner's, by place; places at which either finished no race are left out."""
    found = {}
    for track, drones, summary in _run(evidence, "cruise"):
        other = evidence.summary(planner, track, drones)
        if other and other.speed.known and summary.speed.known:
            found[f"{track}-{drones}"] = summary.speed.mean / other.speed.mean
    return found


def _faster(planner: str, least: float, digits: int) -> Callable[[Evidence], Findings]:
    return lambda evidence: {
        place: Finding(f"{factor:.2f}", round(factor, digits) >= least)
        for place, factor in factors(evidence, planner).items()
    }


def _vanilla_fails(evidence: Evidence) -> Findings:
    return {
        f"{track}-{drones}": Finding(percent(summary.success), summary.success.mean <= FAILED)
        for track, drones, summary in _run(evidence, "vanilla")
        if track == "ring" and drones > DUEL
    }


def _beats(other: str) -> Callable[[Evidence], Findings]:
    def findings(evidence: Evidence) -> Findings:
        rates = {track: win_rate(evidence.met(track, DUEL), "cruise", other) for track in evidence.scale.tracks}
        return {track: Finding(percent(rate), rate.mean > HALF) for track, rate in rates.items() if rate.known}

    return findings


def _stages_grow(evidence: Evidence) -> Findings:
    found = {}
    for track, drones, _ in _run(evidence, "cruise"):
        speeds = [summary.air_speed.mean for summary in evidence.stages("cruise", track, drones).values()]
        if len(speeds) > 1:
            told = f"{speeds[0]:.1f} to {speeds[-1]:.1f} m/s"
            found[f"{track}-{drones}"] = Finding(told, all(after > before for before, after in pairwise(speeds)))
    return found


def _slower_than_the_limit(evidence: Evidence) -> Findings:
    return {
        f"{track}-{drones}": Finding(f"{summary.lap.mean:.2f} s", summary.lap.mean > FREE.lap(track))
        for track, drones, summary in _run(evidence, "cruise")
        if summary.lap.known
    }


def _faster_than(planner: str, least: float, digits: int, printed: str) -> Claim:
    return Claim(f"CRUISE is faster than {KINDS[planner].title}", printed, _faster(planner, least, digits))


def _wins(other: str) -> Claim:
    return Claim(f"CRUISE wins its duels with {KINDS[other].title}", "not raced", _beats(other))


CLAIMS = {
    "fast_as_printed": Claim("CRUISE's mean speed, six cells", "3.4 to 4.4 m/s", _fast),
    "safe_as_printed": Claim("CRUISE's success per drone, six cells", "91.3 to 100 %", _safe),
    # The printed speeds of ring 4 are 4.3 and 2.3 m/s, which the paper calls 1.9 times, too.
    "faster_than_se-ibr": _faster_than("se-ibr", SPEED_FACTOR, 1, f"at least {SPEED_FACTOR} times"),
    "faster_than_se-ibr-tuned": _faster_than("se-ibr-tuned", 1.0, 3, "not compared"),
    "vanilla_fails": Claim(
        "VANILLA fails on the ring with three drones or more", "0 % with 3 and with 4", _vanilla_fails
    ),
    "beats_vanilla": _wins("vanilla"),
    "beats_se-ibr": _wins("se-ibr"),
    "beats_se-ibr-tuned": _wins("se-ibr-tuned"),
    "stages_grow": Claim("Speed grows with every stage", "for every track and number of drones", _stages_grow),
    "slower_than_the_limit": Claim(
        "CRUISE's laps are slower than the fastest possible", "not computed", _slower_than_the_limit
    ),
}
