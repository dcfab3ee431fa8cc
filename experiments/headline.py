"""The three sentences at the top of the report, computed from the evidence."""

from experiments.contrasts import contrasts, percent, sentence, verdict
from experiments.document import Point
from experiments.evidence import Evidence
from experiments.plan import ABLATION_DRONES, DUEL, ENTRANTS, KINDS
from experiments.pooling import compare
from experiments.ratings import Rating, win_rate


def headline(evidence: Evidence, ratings: dict[str, list[Rating]]) -> tuple[Point, ...]:
    """Does the curriculum matter, does self-play matter, who wins."""
    return (
        _ingredient(evidence, "Does the curriculum matter?", "self-play-only", "with self-play in both"),
        _ingredient(evidence, "Does self-play matter?", "curriculum-only", "with the curriculum in both"),
        Point("Who wins against whom?", " ".join(_winner(evidence, track, ratings) for track in evidence.scale.tracks)),
    )


def _ingredient(evidence: Evidence, question: str, without: str, fixed: str) -> Point:
    found = contrasts(evidence, "cruise", without, ABLATION_DRONES)
    if not found:
        return Point(question, f'Not known yet: CRUISE and "{KINDS[without].title}" have not both been run.')
    seeds = min(len(c.without.seeds) for c in found)
    basis = "One training seed each" if seeds == 1 else f"{seeds} training seeds each"
    return Point(question, f"{verdict(found)} {sentence(found)} ({basis}, {fixed}.)")


def _winner(evidence: Evidence, track: str, ratings: dict[str, list[Rating]]) -> str:
    rated = [rating for rating in ratings.get(track, []) if rating.skill.known]
    duels = evidence.met(track, DUEL)
    if not rated or not duels:
        return f"On the {track}: not known yet, the races have not been run."
    best = rated[0]
    alone = compare(best.skill, rated[1].skill) == "higher"
    place = "is rated first" if alone else f"is rated first, within the interval of {KINDS[rated[1].entrant].title}"
    others = [kind for kind in ENTRANTS if kind != best.entrant]
    rates = ", ".join(f"{KINDS[k].title} in {percent(win_rate(duels, best.entrant, k))}" for k in others)
    told = f"On the {track} {KINDS[best.entrant].title} {place} and beats {rates} of their duels."
    return f"{told} {_among_its_own(evidence, track, best.entrant)}".rstrip()


def _among_its_own(evidence: Evidence, track: str, best: str) -> str:
    """Who wins against others need not get through a race against drones like itself."""
    own, ours = (evidence.summary(kind, track, ABLATION_DRONES) for kind in (best, "cruise"))
    if best == "cruise" or not own or not ours:
        return ""
    return (
        f"In fields of {ABLATION_DRONES} of one kind {percent(own.success)} of its drones finish, "
        f"{percent(ours.success)} of CRUISE's."
    )
