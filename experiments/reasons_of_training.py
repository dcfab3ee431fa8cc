"""Reasons that lie in how policies are trained, and what other ways of training make of them."""

from experiments.contrasts import NOT_YET, capital, contrasts, outcome, percent, sentence
from experiments.document import Point
from experiments.evidence import Evidence
from experiments.plan import ABLATION_DRONES, DUEL, KINDS
from experiments.ratings import duel_survival, win_rate


def vanilla(evidence: Evidence) -> Point:
    """What VANILLA is."""
    told = []
    for track in evidence.scale.tracks:
        for kind in ("vanilla", "self-play-only"):
            summary = evidence.summary(kind, track, ABLATION_DRONES)
            alone = _survival_in_training(evidence, track) if kind == "vanilla" else ""
            if summary:
                told.append(f"{track}, {KINDS[kind].title}: {outcome(summary)}{alone}")
    return Point(
        "What VANILLA is, the paper does not quite say.",
        "Here it is plain PPO on stage 5 without curriculum and without self-play, so that it first meets opponents "
        'when it is measured; "self-play, no curriculum" meets them all along, and differs from CRUISE by the '
        f"curriculum alone. {capital('; '.join(told)) + '.' if told else NOT_YET}",
    )


def _survival_in_training(evidence: Evidence, track: str) -> str:
    """How VANILLA flew alone, by the last evaluation of its training."""
    last = []
    for cell in evidence.of("vanilla", track, ABLATION_DRONES):
        known = [value for value in cell.curve.success if value is not None] if cell.curve else []
        last += known[-1:]
    return f" (alone in the air at the end of training it survived {100 * sum(last) / len(last):.0f} %)" if last else ""


def giving_way(evidence: Evidence) -> Point:
    """Who wins a duel between one who looks out for others and one who does not."""
    told = []
    for track in evidence.scale.tracks:
        duels = evidence.met(track, DUEL)
        own = {kind: evidence.summary(kind, track, DUEL) for kind in ("cruise", "vanilla")}
        won = win_rate(duels, "cruise", "vanilla")
        if not won.known or not all(own.values()):
            continue
        lost = win_rate(duels, "vanilla", "cruise")
        finished = duel_survival(duels, "cruise", "vanilla")
        apart = "; ".join(f"{KINDS[kind].title} against itself: {outcome(s)}" for kind, s in own.items() if s)
        told.append(
            f"{track}: CRUISE wins {percent(won)} of its duels with VANILLA, finishes in {percent(finished)} and loses "
            f"{percent(lost)} ({apart})"
        )
    return Point(
        "Success in a field of one's own kind is not winning against others.",
        "The paper measures every method among its own kind. There CRUISE finishes because all of its drones look out "
        "for each other, and VANILLA crashes because none of its does. In one race a drone that keeps to its line "
        f"gains from one that gives way. {capital('; '.join(told)) + '.' if told else NOT_YET}",
    )


def self_play_order(evidence: Evidence) -> Point:
    """Where self-play belongs."""
    return Point(
        "Self-play within the curriculum or after it.",
        "The paper's text puts self-play after the curriculum, its Algorithm 1 inside every stage; the default is "
        f"inside. Inside against after: {contrast(evidence, 'self-play-after')}",
    )


def sparring(evidence: Evidence) -> Point:
    """What sparring partners cost."""
    return Point(
        "Opponents that are not copies.",
        "The paper's drones learn against frozen copies of themselves alone. Trained so, drones crashed in their duels "
        "with planners and hand-written pilots, which fly as no copy does; so here some opponents in training are such "
        "pilots, of many speeds. What that costs among copies, with sparring partners against without: "
        f"{contrast(evidence, 'copies-only')}",
    )


def observation(evidence: Evidence) -> Point:
    """What the observation does."""
    return Point(
        "Another observation than the paper's.",
        "CRUISE here sees the track and its opponents in the frame of the next gate. Against the paper's state vector: "
        f"{contrast(evidence, 'paper-observation')}",
    )


def contrast(evidence: Evidence, without: str) -> str:
    """CRUISE against the same training without an ingredient, in a sentence."""
    return sentence(contrasts(evidence, "cruise", without, ABLATION_DRONES))


def seeds(evidence: Evidence) -> Point:
    """How far seeds differ."""
    spreads = []
    for track in evidence.scale.tracks:
        for drones in evidence.scale.drones:
            rates = [_share(cell.measured.success) for cell in evidence.of("cruise", track, drones)]
            if len(rates) > 1:
                spreads.append((max(rates) - min(rates), f"{track} with {drones} drones", rates))
    if not spreads:
        text = "Fewer than two seeds have been run."
    else:
        _, place, rates = max(spreads)
        text = (
            f"Here CRUISE's seeds differ most on {place}: {', '.join(f'{100 * rate:.1f} %' for rate in rates)} success."
        )
    return Point(
        "One training is no evidence.",
        f"The paper measures one training per cell, over 100 episodes; its deviations are between episodes. {text}",
    )


def _share(values: tuple[float, ...]) -> float:
    return sum(values) / len(values)
