"""Who wins against whom: win rates of pairs, and ratings, with intervals over seeds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cruise.errors import CruiseError
from experiments.head_to_head import winner
from experiments.plan import ENTRANTS
from experiments.pooling import NOTHING, Pooled, pool, pool_rate
from experiments.results import HeadToHead, Meeting

try:
    from openskill.models import PlackettLuce, PlackettLuceRating
except ImportError:
    raise CruiseError("the report's ratings need openskill: pip install -c constraints.txt openskill") from None

RESAMPLES = 100
Game = tuple[tuple[str, ...], tuple[int, ...]]  # entrants and their places


def win_rate(meetings: Sequence[HeadToHead], one: str, other: str) -> Pooled:
    """Share of the duels between two entrants that `one` won; a duel that nobody won counts for neither."""
    return pool_rate([_wins(m, one) for m in _duels(meetings, one, other)], 1)


def duel_survival(meetings: Sequence[HeadToHead], one: str, other: str) -> Pooled:
    """Share of the duels between two entrants that `one` finished."""
    return pool_rate([_finishes(m, one) for m in _duels(meetings, one, other)], 1)


def field_wins(meetings: Sequence[HeadToHead], entrant: str) -> Pooled:
    """Share of the mixed races of all entrants that one of them won."""
    return pool_rate([_wins(m, entrant) for m in _fields(meetings)], 1)


def field_survival(meetings: Sequence[HeadToHead], entrant: str) -> Pooled:
    """Share of the mixed races of all entrants that one of them finished."""
    return pool_rate([_finishes(m, entrant) for m in _fields(meetings)], 1)


def field_place(meetings: Sequence[HeadToHead], entrant: str) -> Pooled:
    """Mean place of an entrant in the mixed races of all."""
    return pool([[float(rank[m.entrants.index(entrant)]) for rank in m.rank] for m in _fields(meetings)])


def _duels(meetings: Sequence[HeadToHead], one: str, other: str) -> list[Meeting]:
    return [m for h in meetings for m in h.meetings if set(m.entrants) == {one, other}]


def _fields(meetings: Sequence[HeadToHead]) -> list[Meeting]:
    return [m for h in meetings for m in h.meetings if m.entrants == ENTRANTS]


def _wins(meeting: Meeting, entrant: str) -> list[float]:
    mine = meeting.entrants.index(entrant)
    races = zip(meeting.rank, meeting.crashed, strict=True)
    return [float(winner(rank, crashed) == mine) for rank, crashed in races]


def _finishes(meeting: Meeting, entrant: str) -> list[float]:
    mine = meeting.entrants.index(entrant)
    return [float(times[mine] is not None) for times in meeting.finish]


@dataclass(frozen=True)
class Rating:
    """Skill on openskill's scale, which starts at 25; only differences mean something."""

    entrant: str
    skill: Pooled


def rate(by_seed: Sequence[Sequence[HeadToHead]], resamples: int = RESAMPLES) -> list[Rating]:
    """Ratings (Plackett-Luce) of all entrants from duels and mixed races together, best first.

    The interval is the 2.5th to the 97.5th percentile over a bootstrap that draws seeds, then races of each seed, with
    replacement, and plays them in random order; the rating is the mean over it. With few seeds such an interval is
    rather too narrow.

    Args:
        by_seed: the meetings of every seed.
        resamples: of the bootstrap.
    """
    games = [[game for result in results for game in _games(result)] for results in by_seed]
    games = [seed for seed in games if seed]
    if not games:
        return [Rating(entrant, NOTHING) for entrant in ENTRANTS]
    rng = np.random.default_rng(0)
    skills = np.array([_play(_resample(games, rng)) for _ in range(resamples)])
    low, high = np.percentile(skills, (2.5, 97.5), axis=0)
    races = sum(len(seed) for seed in games)
    ratings = [
        Rating(entrant, Pooled(float(skills[:, i].mean()), float(low[i]), float(high[i]), len(games), races))
        for i, entrant in enumerate(ENTRANTS)
    ]
    return sorted(ratings, key=lambda rating: -rating.skill.mean)


def _games(result: HeadToHead) -> list[Game]:
    return [(meeting.entrants, rank) for meeting in result.meetings for rank in meeting.rank]


def _resample(games: Sequence[Sequence[Game]], rng: np.random.Generator) -> list[Game]:
    drawn: list[Game] = []
    for seed in rng.integers(len(games), size=len(games)):
        drawn += [games[seed][i] for i in rng.integers(len(games[seed]), size=len(games[seed]))]
    return [drawn[i] for i in rng.permutation(len(drawn))]


def _play(games: Sequence[Game]) -> list[float]:
    """Ratings after these games. Skill does not drift here, so tau is 0."""
    model = PlackettLuce(tau=0.0)
    ratings: dict[str, PlackettLuceRating] = {entrant: model.rating(name=entrant) for entrant in ENTRANTS}
    for entrants, places in games:
        teams = model.rate([[ratings[entrant]] for entrant in entrants], ranks=[float(p) for p in places])
        ratings |= {entrant: team[0] for entrant, team in zip(entrants, teams, strict=True)}
    return [ratings[entrant].mu for entrant in ENTRANTS]
