"""Results that nobody measured, for tests of what is done with results."""

import dataclasses

import numpy as np

from cruise.presets import CURRICULUM, PAPER_TRACKS
from cruise.storage.config_file import to_data
from experiments.evidence import track_length
from experiments.learned import Cell
from experiments.plan import DUEL, ENTRANTS, Job, Scale, config_of, make_plan
from experiments.results import FORMAT, Curve, HeadToHead, Measured, Meeting, Origin, ResultFolder, StageResult
from experiments.settings import settings_of

# Success and speed of each kind; a drone's lap follows from its speed.
LEVELS = {
    "cruise": (0.97, 4.3),
    "vanilla": (0.2, 3.0),
    "se-ibr": (0.9, 2.0),
    "se-ibr-tuned": (0.93, 4.0),
    "self-play-only": (0.8, 4.1),
    "curriculum-only": (0.3, 4.2),
    "self-play-after": (0.95, 4.2),
    "copies-only": (0.98, 4.3),
    "paper-reward": (0.0, 3.0),
    "paper-observation": (0.85, 4.0),
    "vanilla-stage5": (0.15, 2.8),
}
ORIGIN = Origin("cruise reproduce", "0.0.0", "0.10.0", "3.11.0", "cpu, 2 cores", "full", 12.5)


def invent_measured(job: Job, success: float, speed: float, races: int, rng: np.random.Generator) -> Measured:
    """Races whose drones finish with this probability, seeds a little apart."""
    success = float(np.clip(success + rng.normal(0, 0.02) * (0 < success < 1), 0, 1))
    finished = rng.random((races, job.drones)) < success
    speeds = speed + rng.normal(0, 0.05) + rng.normal(0, 0.03, races)
    anybody = finished.any(axis=1)
    kept = tuple(float(v) if here else None for v, here in zip(speeds, anybody, strict=True))
    laps = tuple(None if v is None else track_length(job.track) / v * 0.99 for v in kept)
    out = int((~finished).sum())
    return Measured(
        seed=2000 + job.seed,
        drones=job.drones,
        success=tuple(float(share) for share in finished.mean(axis=1)),
        speed=kept,
        air_speed=tuple(float(v) for v in speeds),
        lap=laps,
        first_lap=tuple(None if lap is None else lap + 2.0 for lap in laps),
        collisions=tuple(int(n) for n in (~finished).sum(axis=1)),
        overtakes=tuple(int(n) for n in rng.poisson(1.0, races)),
        fates={"finished": races * job.drones - out, "hit a drone": out},
    )


def invent_cell(job: Job, scale: Scale) -> Cell:
    """A cell of a kind, the same for the same job."""
    rng = np.random.default_rng([job.seed, job.drones, *job.name.encode()])
    success, speed = LEVELS[job.kind]
    speed *= 1.0 if job.track == "ring" else 0.8
    measured = invent_measured(job, success, speed, scale.races, rng)
    if job.family == "planner":
        cell = Cell(FORMAT, job.kind, job.track, job.drones, job.seed, ORIGIN, measured)
        return dataclasses.replace(cell, config=settings_of(job, scale))
    config = config_of(job, scale)
    return Cell(
        format=FORMAT,
        kind=job.kind,
        track=job.track,
        drones=job.drones,
        seed=job.seed,
        origin=ORIGIN,
        measured=measured,
        steps=39_976_960,
        training_seconds=274.0,
        training_command="cruise train",
        config=to_data(config),
        stages=invent_stages(job, scale, measured, config.vanilla, rng),
        curve=invent_curve(success, speed, rng),
    )


def invent_stages(job: Job, scale: Scale, last: Measured, vanilla: bool, rng: np.random.Generator):
    """Stages that grow faster; the last is the finished policy."""
    final = StageResult(5, CURRICULUM[-1].name, CURRICULUM[-1].agility, last)
    if vanilla:
        return (final,)
    early = []
    for number, stage in enumerate(CURRICULUM[:-1], start=1):
        measured = invent_measured(job, 0.2 * number, 1.2 + 0.6 * number, scale.races, rng)
        early.append(StageResult(number, stage.name, stage.agility, measured))
    return (*early, final)


def invent_curve(success: float, speed: float, rng: np.random.Generator) -> Curve:
    """A curve that rises, its evaluations seldom."""
    share = np.linspace(0.02, 1.0, 50)
    noisy = np.clip(success * share + rng.normal(0, 0.02, 50), 0, 1)
    seldom = [i % 3 == 0 for i in range(50)]
    return Curve(
        steps=tuple(int(40e6 * s) for s in share),
        stage=tuple(int(1 + 4 * s) for s in share),
        reward=tuple(float(s) for s in share),
        speed=tuple(float(speed * s**0.3) if here else None for s, here in zip(share, seldom, strict=True)),
        success=tuple(float(v) if here else None for v, here in zip(noisy, seldom, strict=True)),
        lap=(None,) * 50,
        win_rate=(0.5,) * 50,
    )


def invent_meetings(job: Job, scale: Scale) -> HeadToHead:
    """Races in which success and speed decide, with luck."""
    rng = np.random.default_rng([7, job.seed, job.drones, len(job.track)])
    fields = [(a, b) for i, a in enumerate(ENTRANTS) for b in ENTRANTS[i + 1 :]] if job.drones == DUEL else [ENTRANTS]
    meetings = []
    for entrants in fields:
        rank, finish, crashed = [], [], []
        for _ in range(scale.races):
            out = [bool(rng.random() > LEVELS[kind][0]) for kind in entrants]
            times = [
                None if gone else float(180 / LEVELS[kind][1] + rng.normal(0, 2))
                for kind, gone in zip(entrants, out, strict=True)
            ]
            rank.append(tuple(1 + sum((o or np.inf) < (t or np.inf) for o in times) for t in times))
            finish.append(tuple(times))
            crashed.append(tuple(out))
        meetings.append(Meeting(entrants, tuple(rank), tuple(finish), tuple(crashed)))
    policies = {"cruise": "", "vanilla": ""}
    return HeadToHead(FORMAT, job.track, job.drones, job.seed, ORIGIN, policies, tuple(meetings))


def invent(folder: ResultFolder, scale: Scale, jobs: tuple[Job, ...] | None = None) -> None:
    """Write results of all jobs of a plan, or of these."""
    for job in make_plan(scale) if jobs is None else jobs:
        result = invent_meetings(job, scale) if job.family == "head-to-head" else invent_cell(job, scale)
        folder.write(job, result)


assert set(PAPER_TRACKS) == {"ring", "figure-eight"}
