"""What there is to run, as data: kinds of pilots, and jobs of one kind, track, number of drones and seed."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from cruise.config import SelfPlayMode, TrainConfig
from cruise.errors import CruiseError
from cruise.presets import CURRICULUM, PAPER_TRACKS, REWARDS, training_config

Family = Literal["learned", "planner", "head-to-head"]


def _same(config: TrainConfig) -> TrainConfig:
    return config


@dataclass(frozen=True)
class Kind:
    """A way to make pilots, or to let them meet."""

    name: str
    title: str  # in tables and figures
    summary: str  # for somebody who has not read the paper
    family: Family = "learned"
    change: Callable[[TrainConfig], TrainConfig] = _same  # what differs from CRUISE's training


def _self_play(mode: SelfPlayMode) -> Callable[[TrainConfig], TrainConfig]:
    return lambda config: replace(config, opponents=replace(config.opponents, self_play=mode))


def _against_copies(config: TrainConfig) -> TrainConfig:
    return replace(config, opponents=replace(config.opponents, sparring_share=0.0))


def _as_printed(config: TrainConfig) -> TrainConfig:
    return replace(config, reward=REWARDS["paper"], ppo=replace(config.ppo, after_crash="nothing"))


def _from_scratch(mode: SelfPlayMode, share: float = 1.0) -> Callable[[TrainConfig], TrainConfig]:
    """Stage 5 alone, for this share of the whole curriculum's steps."""
    return lambda config: replace(_self_play(mode)(config), vanilla=True, step_scale=share * config.step_scale)


LAST_SHARE = CURRICULUM[-1].steps / sum(stage.steps for stage in CURRICULUM)

_KINDS = (
    Kind("cruise", "CRUISE", "five stages of growing difficulty, self-play in every stage"),
    Kind(
        "vanilla",
        "VANILLA",
        "stage 5 from scratch, without opponents in training, for as many steps as CRUISE",
        change=_from_scratch("off"),
    ),
    Kind("se-ibr", "SE-IBR, paper's caps", "game-theoretic planner with the paper's speed caps", "planner"),
    Kind(
        "se-ibr-tuned", "SE-IBR, tuned", "the same planner, limited only by what the vehicle can do", family="planner"
    ),
    Kind("head-to-head", "head-to-head", "the four above in the same races", family="head-to-head"),
    Kind(
        "self-play-only",
        "self-play, no curriculum",
        "stage 5 from scratch with self-play, for as many steps as CRUISE",
        change=_from_scratch("within"),
    ),
    Kind(
        "curriculum-only",
        "curriculum, no self-play",
        "the five stages, without opponents in training",
        change=_self_play("off"),
    ),
    Kind(
        "self-play-after",
        "self-play after the curriculum",
        "the five stages alone, then self-play in what stage 5 keeps for it",
        change=_self_play("after"),
    ),
    Kind(
        "copies-only",
        "against copies alone",
        "CRUISE whose opponents in training are all frozen copies of itself, as in the paper: nobody to spar with",
        change=_against_copies,
    ),
    Kind(
        "paper-reward",
        "printed reward weights",
        "CRUISE with the reward exactly as printed, the sign of the overtaking bonus too, and nothing after a crash",
        change=_as_printed,
    ),
    Kind(
        "paper-observation",
        "the paper's observation",
        "CRUISE with the paper's state vector in place of the extended one",
        change=lambda config: replace(config, observation="paper"),
    ),
    Kind(
        "vanilla-stage5",
        "VANILLA, stage 5's steps",
        "VANILLA for the steps of stage 5 alone, half of the whole",
        change=_from_scratch("off", LAST_SHARE),
    ),
)
KINDS: dict[str, Kind] = {kind.name: kind for kind in _KINDS}
ENTRANTS = ("cruise", "vanilla", "se-ibr", "se-ibr-tuned")  # of the head-to-head races
ABLATIONS = (
    *("curriculum-only", "self-play-only", "self-play-after"),
    *("copies-only", "paper-reward", "paper-observation"),
)
ABLATION_DRONES = 4
DRONES = (2, 3, 4)
DUEL, MIXED = 2, 4  # drones of the head-to-head races: every pair, and one of each


@dataclass(frozen=True)
class Job:
    """One thing to run; its result is one file."""

    kind: str
    track: str
    drones: int
    seed: int  # of the training, and of the races that measure it

    @property
    def name(self) -> str:
        """Stem of its file."""
        return f"{self.track}-{self.drones}-{self.kind}-s{self.seed}"

    @property
    def family(self) -> Family:
        """How it is made."""
        return KINDS[self.kind].family


@dataclass(frozen=True)
class Scale:
    """How much of everything: the full study, or a quick one."""

    name: str
    change: Callable[[TrainConfig], TrainConfig] = _same  # what differs from usual training
    races: int = 100  # per evaluation and per head-to-head pairing
    seeds: tuple[int, ...] = (0, 1, 2)
    tracks: tuple[str, ...] = tuple(PAPER_TRACKS)
    kinds: tuple[str, ...] = tuple(KINDS)
    ablation_tracks: tuple[str, ...] = tuple(PAPER_TRACKS)
    drones: tuple[int, ...] = DRONES

    def base(self, drones: int) -> TrainConfig:
        """How so many drones are trained, before their kind, track and seed."""
        return self.change(training_config(drones=drones))

    @property
    def step_scale(self) -> float:
        """Share of the paper's steps."""
        return self.base(ABLATION_DRONES).step_scale

    @property
    def steps(self) -> int:
        """Of one whole curriculum."""
        return round(self.step_scale * sum(stage.steps for stage in CURRICULUM))


QUICK_SHARE = 0.02  # of the steps
QUICK_EVALUATIONS = 131_072  # steps between two evaluations of self-play


def full_scale(seeds: int = 3) -> Scale:
    """The paper's 40 million steps, 100 races."""
    return Scale("full", seeds=tuple(range(seeds)))


def _quickly(config: TrainConfig) -> TrainConfig:
    opponents = replace(config.opponents, evaluate_every=QUICK_EVALUATIONS)
    return replace(config, step_scale=QUICK_SHARE, opponents=opponents)


def quick_scale() -> Scale:
    """A look at everything in minutes; its policies have hardly learned to fly."""
    return Scale(
        "quick",
        _quickly,
        races=10,
        seeds=(0,),
        kinds=tuple(kind for kind in KINDS if kind != "vanilla-stage5"),
        ablation_tracks=("ring",),
    )


def make_plan(scale: Scale) -> tuple[Job, ...]:
    """Every job, in the order in which they are run: something whole early, the finer questions last."""
    return tuple(job for job in dict.fromkeys(_ordered(scale)) if job.kind in scale.kinds)


def _ordered(scale: Scale) -> Iterator[Job]:
    for seed in scale.seeds:
        for kind in ENTRANTS:
            yield from (Job(kind, track, n, seed) for track in scale.tracks for n in scale.drones)
        met = [n for n in (DUEL, MIXED) if n in scale.drones]
        yield from (Job("head-to-head", track, n, seed) for track in scale.tracks for n in met)
    for seed in scale.seeds:
        if ABLATION_DRONES in scale.drones:
            yield from (
                Job(kind, track, ABLATION_DRONES, seed) for kind in ABLATIONS for track in scale.ablation_tracks
            )
    for seed in scale.seeds:
        yield from (Job("vanilla-stage5", track, n, seed) for track in scale.tracks for n in scale.drones)
    for seed in scale.seeds:
        yield from (Job("self-play-only", track, n, seed) for track in scale.ablation_tracks for n in scale.drones)


def config_of(job: Job, scale: Scale) -> TrainConfig:
    """How a learned job is trained."""
    return KINDS[job.kind].change(replace(scale.base(job.drones), track=job.track, seed=job.seed))


def choose(jobs: Sequence[Job], words: Sequence[str]) -> tuple[Job, ...]:
    """The jobs that fit every word given: kinds, tracks, numbers of drones, seeds as `s0`. Words of one sort are or-ed.

    Raises:
        CruiseError: a word that fits no job of the plan.
    """
    sorts: dict[str, set[str]] = {}
    for word in words:
        sort = next((name for name, label in _LABELS.items() if any(word == label(job) for job in jobs)), None)
        if sort is None:
            known = [dict.fromkeys(label(job) for job in jobs) for label in _LABELS.values()]
            raise CruiseError(f"--only {word!r} fits nothing: {'; '.join(', '.join(labels) for labels in known)}")
        sorts.setdefault(sort, set()).add(word)
    return tuple(job for job in jobs if all(_LABELS[sort](job) in wanted for sort, wanted in sorts.items()))


_LABELS: dict[str, Callable[[Job], str]] = {
    "kind": lambda job: job.kind,
    "track": lambda job: job.track,
    "drones": lambda job: str(job.drones),
    "seed": lambda job: f"s{job.seed}",
}
