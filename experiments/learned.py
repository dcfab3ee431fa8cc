"""A learned cell: train, measure the policy of every stage and the finished one, keep what the report needs."""

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path

from cruise.config import TrainConfig
from cruise.evaluation.matches import make_match, run_races
from cruise.racing.track_file import load_track
from cruise.storage.atomic import read_bytes, write_atomically
from cruise.training.metrics_log import read_metrics
from cruise.training.session import CONFIG, Session
from cruise.training.validation import check_config
from cruise.vehicles import find_vehicle
from experiments.commands import train_command
from experiments.measure import FRESH, load_as, measure, thin_curve
from experiments.plan import DUEL, ENTRANTS, MIXED, Job, config_of
from experiments.results import FORMAT, Cell, Origin, StageResult
from experiments.settings import settings_of
from experiments.work import Step, Work


def make_learned(work: Work, job: Job) -> Iterator[Step]:
    """Train, or go on training, and write the result. The policy of the last stage is the finished one."""
    started = time.monotonic()
    config = config_of(job, work.scale)
    check_config(config)
    session = _open(work.run_folder(job), config)
    for progress in session:
        yield Step("training", progress.steps, session.trainer.total_steps)
    policy = session.finish(lambda _: {})
    measured = []
    for number, phase in enumerate(session.trainer.phases, start=1):
        yield Step("measuring", number - 1, len(session.trainer.phases))
        if phase.last_update > phase.first_update:
            measured.append(_measure_stage(work, job, session, number))
    _keep(work, job, policy)
    work.results.write(job, _cell(work, job, session, tuple(measured), work.origin(job, started)))


def _cell(work: Work, job: Job, session: Session, stages: tuple[StageResult, ...], origin: Origin) -> Cell:
    rows = read_metrics(session.folder)
    return Cell(
        format=FORMAT,
        kind=job.kind,
        track=job.track,
        drones=job.drones,
        seed=job.seed,
        origin=origin,
        measured=stages[-1].measured,
        steps=rows[-1]["steps"],
        training_seconds=rows[-1]["seconds"],
        training_command=train_command(session.config),
        config=settings_of(job, work.scale),
        stages=stages,
        curve=thin_curve(rows),
    )


def _open(folder: Path, config: TrainConfig) -> Session:
    resume = (folder / CONFIG).exists()
    return Session(folder, config, load_track(config.track), find_vehicle(config.vehicle), resume=resume)


def _measure_stage(work: Work, job: Job, session: Session, number: int) -> StageResult:
    pilot = load_as(session.folder / f"stage-{number}", job.kind)
    measured = measure(make_match(session.track, job.drones, pilot), work.scale.races, job.seed)
    phase = session.trainer.phases[number - 1]
    return StageResult(phase.number, phase.stage.name, pilot.agility, measured)


def _keep(work: Work, job: Job, policy: Path) -> None:
    """The policies that race head to head, and one race of four for the pictures."""
    if job.kind not in ENTRANTS or job.drones not in (DUEL, MIXED):
        return
    target = work.results.policy_of(job)
    for ending in (".safetensors", ".json"):
        write_atomically(target.with_name(target.name + ending), read_bytes(policy.with_suffix(ending), "policy"))
    if job.kind == "cruise" and job.drones == MIXED and job.seed == work.scale.seeds[0]:
        match = make_match(load_track(job.track), job.drones, load_as(policy, job.kind))
        next(run_races(match, 1, FRESH + job.seed)).save(work.results.race_of(job))


def make_planner(work: Work, job: Job) -> Iterator[Step]:
    """Measure a planner, which needs no training, and write the result."""
    started = time.monotonic()
    yield Step("measuring")
    match = make_match(load_track(job.track), job.drones, job.kind)
    measured = measure(match, work.scale.races, job.seed)
    cell = Cell(FORMAT, job.kind, job.track, job.drones, job.seed, work.origin(job, started), measured)
    work.results.write(job, dataclasses.replace(cell, config=settings_of(job, work.scale)))
