"""The numbers of the report's page by name: `cruise.ring.4.success` is 99.0 %. A name without results is "not run"."""

from collections.abc import Callable, Iterator

from cruise.config import CascadeGains, Vehicle
from cruise.presets import CURRICULUM, PAPER_TRACKS
from experiments.claims import CLAIMS, factors, verdict
from experiments.entries import NOT_RUN, percent
from experiments.evidence import Evidence
from experiments.plan import ABLATION_DRONES, ABLATIONS, DRONES, DUEL, ENTRANTS, KINDS
from experiments.pooling import Pooled, compare
from experiments.printed import FREE
from experiments.ratings import Rating, duel_survival, win_rate
from experiments.settings import PLANNERS

Named = Iterator[tuple[str, str]]


def _plain(pooled: Pooled) -> str:
    return f"{pooled.mean:.2f}" if pooled.known else "none"


QUANTITIES: dict[str, Callable[[Pooled], str]] = {
    "success": percent,
    "all_success": percent,
    "speed": _plain,
    "lap": _plain,
    "nominal_lap": _plain,
    "overtakes": _plain,
}


def named(evidence: Evidence, ratings: dict[str, list[Rating]]) -> dict[str, str]:
    """Every name and its value."""
    seeds = [len(evidence.of(kind, track, ABLATION_DRONES)) for kind in ABLATIONS for track in PAPER_TRACKS]
    values = {"acceleration": f"{longest_acceleration():.1f}", "seeds": str(min(seeds)) if min(seeds) else NOT_RUN}
    for part in (_quantities, _comparisons, _claims, _duels, _paces, _planners, _trainings, _spread):
        values |= part(evidence)
    return values | dict(_rated(ratings))


def longest_acceleration() -> float:
    """What the paper's cascade sustains along an axis with the last stage's agility [m/s^2]."""
    gains = CascadeGains()
    return gains.position_p * gains.velocity_p * CURRICULUM[-1].agility * Vehicle().control_dt


def _quantities(evidence: Evidence) -> Named:
    for kind in KINDS:
        for track in PAPER_TRACKS:
            for drones in DRONES:
                summary = evidence.summary(kind, track, drones)
                for quantity, shown in QUANTITIES.items():
                    value = shown(getattr(summary, quantity)) if summary else NOT_RUN
                    yield f"{kind}.{track}.{drones}.{quantity}", value


def _comparisons(evidence: Evidence) -> Named:
    """Whether CRUISE's quantity is higher or lower than another kind's: only where intervals do not overlap."""
    for kind in KINDS:
        for track in PAPER_TRACKS:
            own, other = (evidence.summary(k, track, ABLATION_DRONES) for k in ("cruise", kind))
            for quantity in ("success", "lap"):
                known = own and other
                told = compare(getattr(own, quantity), getattr(other, quantity)) if known else NOT_RUN
                yield f"compare.{kind}.{quantity}.{track}", told


def _claims(evidence: Evidence) -> Named:
    for name, claim in CLAIMS.items():
        findings = claim.findings(evidence)
        yield f"check.{name}", verdict(findings)
        for track in PAPER_TRACKS:
            for place in (track, *(f"{track}-{drones}" for drones in DRONES)):
                alone = {place: findings[place]} if place in findings else {}
                yield f"check.{name}.{place}", verdict(alone)


def _duels(evidence: Evidence) -> Named:
    for track in PAPER_TRACKS:
        met = evidence.met(track, DUEL)
        for one in ENTRANTS:
            for other in ENTRANTS:
                won, finished = win_rate(met, one, other), duel_survival(met, one, other)
                yield f"duel.{one}.{other}.{track}", percent(won) if won.known else NOT_RUN
                yield f"survival.{one}.{other}.{track}", percent(finished) if finished.known else NOT_RUN


def _rated(ratings: dict[str, list[Rating]]) -> Named:
    """Who is rated first and second, and whether their intervals lie apart."""
    for track in PAPER_TRACKS:
        rated = [rating for rating in ratings.get(track, ()) if rating.skill.known][:2]
        names = [KINDS[rating.entrant].title for rating in rated] or [NOT_RUN, NOT_RUN]
        apart = {"higher": "yes", "not told apart": "no"}
        yield f"rated.first.{track}", names[0]
        yield f"rated.second.{track}", names[1]
        yield f"rated.apart.{track}", apart[compare(rated[0].skill, rated[1].skill)] if rated else NOT_RUN


def _paces(evidence: Evidence) -> Named:
    """The fastest possible lap over that of the most drones of CRUISE that were run."""
    for track in PAPER_TRACKS:
        laps = [s.lap for n in DRONES if (s := evidence.summary("cruise", track, n)) and s.lap.known]
        yield f"pace.{track}", f"{100 * FREE.lap(track) / laps[-1].mean:.0f} %" if laps else NOT_RUN


def _planners(evidence: Evidence) -> Named:
    """The speeds that the planner's two settings aim at, and how much faster CRUISE is."""
    for planner in PLANNERS:
        for track in PAPER_TRACKS:
            speeds = [cell.config["speed"] for cell in evidence.of_any(planner, track) if "speed" in cell.config]
            yield f"cap.{planner}.{track}", f"{speeds[0]:g}" if speeds else NOT_RUN
        found = factors(evidence, planner).values()
        yield f"factor.{planner}", f"{min(found):.2f} to {max(found):.2f}" if found else NOT_RUN


def _trainings(evidence: Evidence) -> Named:
    """How VANILLA flew alone, by the last evaluation of each training."""
    for track in PAPER_TRACKS:
        cells = evidence.of("vanilla", track, ABLATION_DRONES)
        known = [[v for v in cell.curve.success if v is not None][-1:] for cell in cells if cell.curve]
        last = [value for values in known for value in values]
        yield f"alone.vanilla.{track}", f"{100 * sum(last) / len(last):.0f} %" if last else NOT_RUN


def _spread(evidence: Evidence) -> Named:
    """Where CRUISE's seeds differ most in success."""
    spreads = []
    for track in PAPER_TRACKS:
        for drones in DRONES:
            shares = [cell.measured.success for cell in evidence.of("cruise", track, drones)]
            rates = [sum(share) / len(share) for share in shares]
            if len(rates) > 1:
                spreads.append((max(rates) - min(rates), f"the {track} with {drones} drones", rates))
    _, place, rates = max(spreads, default=(0.0, NOT_RUN, []))
    yield "spread.place", place
    yield "spread.rates", ", ".join(f"{100 * rate:.1f} %" for rate in rates) or NOT_RUN
