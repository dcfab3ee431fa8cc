"""The report's tables of who wins against whom."""

from itertools import permutations

from experiments.entries import number, scale_note
from experiments.evidence import Evidence
from experiments.plan import DUEL, ENTRANTS, KINDS, MIXED
from experiments.ratings import Rating, field_place, field_survival, field_wins, win_rate
from experiments.table import Entry, Table


def duel_table(evidence: Evidence) -> Table:
    """Win rates of every pair."""
    rows: list[tuple[Entry, ...]] = []
    for track in evidence.scale.tracks:
        met = evidence.met(track, DUEL)
        for one, other in permutations(ENTRANTS, 2):
            rate = win_rate(met, one, other) if met else None
            races = str(rate.races) if rate else "0"
            rows.append((track, KINDS[one].title, KINDS[other].title, number(rate, 100, 1), races))
    return Table(
        "duels",
        "Duels: how often the first pilot beats the second",
        ("track", "pilot", "against", "won [%]", "races"),
        tuple(rows),
        scale_note(evidence),
    )


def field_table(evidence: Evidence, ratings: dict[str, list[Rating]]) -> Table:
    """Mixed fields of four, and ratings."""
    rows: list[tuple[Entry, ...]] = []
    for track in evidence.scale.tracks:
        met = evidence.met(track, MIXED)
        skills = {rating.entrant: rating.skill for rating in ratings.get(track, [])}
        for kind in ENTRANTS:
            won, finished, place = ((f(met, kind) if met else None) for f in (field_wins, field_survival, field_place))
            skill = skills.get(kind)
            skill = skill if skill and skill.known else None
            rows.append(
                (
                    track,
                    KINDS[kind].title,
                    number(won, 100, 1),
                    number(finished, 100, 1),
                    number(place),
                    number(skill, 1, 1),
                )
            )
    return Table(
        "mixed-fields",
        "One of each in the same race, and ratings from all meetings",
        ("track", "pilot", "won [%]", "finished [%]", "mean place", "rating"),
        tuple(rows),
        scale_note(evidence),
    )
