"""What did not reproduce, and why: a point per reason, its figures from the evidence."""

import math
from collections.abc import Callable

from cruise.config import CascadeGains, Vehicle
from cruise.presets import CURRICULUM, REWARDS
from experiments import reasons_of_training as of_training
from experiments.claims import factors, short_of, speeds, successes
from experiments.contrasts import NOT_YET, capital, percent
from experiments.document import Point
from experiments.evidence import Evidence
from experiments.plan import ABLATION_DRONES, KINDS
from experiments.pooling import Summary
from experiments.printed import FREE, SPEED_FACTOR, TABLES
from experiments.settings import PLANNERS


def reasons(evidence: Evidence) -> tuple[Point, ...]:
    """In order of weight."""
    points: tuple[Callable[[Evidence], Point], ...] = (
        _shortfalls,
        _controller,
        _nominal_laps,
        _capped_planner,
        _crashing_pays,
        _overtaking,
        of_training.vanilla,
        of_training.giving_way,
        _per_drone,
        of_training.self_play_order,
        of_training.sparring,
        of_training.observation,
        of_training.seeds,
    )
    return tuple(point(evidence) for point in points)


def _shortfalls(evidence: Evidence) -> Point:
    head = "Where CRUISE is below the printed figures."
    if not any(kind == "cruise" for kind, _, _ in evidence.cells):
        return Point(head, NOT_YET)
    slow, unsafe = short_of(evidence, speeds, "m/s"), short_of(evidence, successes, "%")
    told = [f"Mean speed: {', '.join(slow) or 'nowhere'}.", f"Success: {', '.join(unsafe) or 'nowhere'}."]
    if slow or unsafe:
        where = "ablations and in that of single trainings below it" if evidence.trials else "ablations"
        told.append(f"What else was tried is in the table of {where}.")
    return Point(head, " ".join(told))


def _each_track(evidence: Evidence, tell: Callable[[str, Summary], str]) -> str:
    """A phrase per track on CRUISE with the most drones that were run."""
    told = []
    for track in evidence.scale.tracks:
        found = [s for n in evidence.scale.drones if (s := evidence.summary("cruise", track, n)) and s.lap.known]
        if found:
            told.append(f"{track}: {tell(track, found[-1])}")
    return "; ".join(told) + "." if told else NOT_YET


def _controller(evidence: Evidence) -> Point:
    def tell(track: str, summary: Summary) -> str:
        printed = min(lap for (t, kind, _), (lap, *_) in TABLES.items() if t == track and kind == "cruise" and lap)
        limit = FREE.lap(track)
        return (
            f"the fastest possible lap is {limit:.1f} s; the paper's best, nominally {printed:.1f} s, reaches "
            f"{100 * limit / printed:.0f} % of that pace and CRUISE here {100 * limit / summary.lap.mean:.0f} %"
        )

    return Point(
        "The speeds are set by the controller, not by tactics.",
        "The paper reads speeds far below the 10 m/s of its last stage as a strategy that balances speed and safety. "
        "But its controller cannot accelerate along any axis by more than K_p,pos K_v alpha dt = "
        f"{_longest_acceleration():.1f} m/s² for long, and that bounds the lap. "
        f"{capital(_each_track(evidence, tell))}",
    )


def _longest_acceleration() -> float:
    """What the paper's cascade sustains with the last stage's agility [m/s^2]."""
    gains = CascadeGains()
    return gains.position_p * gains.velocity_p * CURRICULUM[-1].agility * Vehicle().control_dt


def _nominal_laps(evidence: Evidence) -> Point:
    def tell(track: str, summary: Summary) -> str:
        nominal, timed = summary.nominal_lap.mean, summary.lap.mean
        return f"nominal {nominal:.2f} s, timed {timed:.2f} s ({100 * (nominal / timed - 1):+.1f} %)"

    return Point(
        "Printed laps were not timed.",
        "The paper's lap time is the length of the track over the mean speed: it rewards flying far, not arriving "
        "early. Here laps are timed from gate to gate as well. "
        f"{capital(_each_track(evidence, tell))}",
    )


def _capped_planner(evidence: Evidence) -> Point:
    paper, tuned = factors(evidence, "se-ibr"), factors(evidence, "se-ibr-tuned")
    if not paper or not tuned:
        text = NOT_YET
    else:
        text = (
            f"CRUISE is {_range(paper)} times as fast as the planner with the paper's caps (paper: about "
            f"{SPEED_FACTOR:g}) and {_range(tuned)} times as fast as the same planner limited by the vehicle alone."
        )
    return Point(
        "The planner was held back.",
        f"The planner's speed is the speed it is allowed{_allowed(evidence)}: the caps in the paper's repository "
        f"decide the comparison. {text}",
    )


def _allowed(evidence: Evidence) -> str:
    """The speeds that the planner's two settings aim at."""
    told = []
    for track in evidence.scale.tracks:
        caps = [cells[0].config.get("speed") for k in PLANNERS if (cells := evidence.of_any(k, track))]
        if len(caps) == len(PLANNERS) and all(isinstance(cap, int | float) for cap in caps):
            told.append(f"{track}: {caps[0]:g} m/s with the paper's caps, {caps[1]:g} m/s tuned")
    return f" ({'; '.join(told)})" if told else ""


def _range(found: dict[str, float]) -> str:
    low, high = min(found.values()), max(found.values())
    return f"{low:.2f}" if round(low, 2) == round(high, 2) else f"{low:.2f} to {high:.2f}"


def _crashing_pays(evidence: Evidence) -> Point:
    weights, last = REWARDS["paper"], CURRICULUM[-1]
    speed = TABLES["ring", "cruise", ABLATION_DRONES].speed or math.nan
    cost = weights.w_speed * (last.v_min - speed)
    return Point(
        "The printed reward weights make crashing attractive.",
        f"At stage 5 the speed term alone costs {weights.w_speed:g} x ({last.v_min:g} - {speed:g}) = {cost:.1f} a "
        f"step, while a crash costs {-weights.terminal:g} once and ends the cost; and above the clip of "
        f"{weights.clip:g} nothing is gained by flying faster. The default pays for speed from rest on, so that "
        "nothing is gained by dying. With the default weights against the printed ones: "
        f"{of_training.contrast(evidence, 'paper-reward')}",
    )


def _overtaking(evidence: Evidence) -> Point:
    overtakes = []
    for track in evidence.scale.tracks:
        for kind in ("cruise", "paper-reward"):
            summary = evidence.summary(kind, track, ABLATION_DRONES)
            if summary:
                overtakes.append(f"{track}, {KINDS[kind].title}: {summary.overtakes.mean:.2f}")
    told = f"Overtakes per race of {ABLATION_DRONES}: {'; '.join(overtakes)}." if overtakes else NOT_YET
    return Point(
        "The overtaking bonus has the wrong sign.",
        "As printed, a drone is paid when an opponent comes from behind it to before it: for being overtaken. CRUISE "
        "here is paid for the opposite; the training with the printed weights keeps the printed sign. "
        f"{told}",
    )


def _per_drone(evidence: Evidence) -> Point:
    def tell(track: str, summary: Summary) -> str:
        return f"{percent(summary.success)} of the drones, all drones in {percent(summary.all_success)} of the races"

    return Point(
        "Success is per drone.",
        "Printed figures such as 91.3 % of three and 93.5 % of four drones over 100 episodes can only be shares of "
        f"drones. Whether everybody finishes is a stricter question. {capital(_each_track(evidence, tell))}",
    )
