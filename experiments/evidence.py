"""Everything in a results folder, read and grouped for the report."""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cruise.errors import CruiseError
from cruise.presets import PAPER_TRACKS
from cruise.racing.track_geometry import lap_length
from cruise.storage.policy_file import PolicyMeta
from cruise.storage.race_log import RaceLog, load_race_log
from experiments.plan import KINDS, Job, Scale
from experiments.pooling import Summary, summarise, summarise_cells
from experiments.results import CELLS, MEETINGS, Cell, HeadToHead, ResultFolder
from experiments.settings import agree
from experiments.trials import read_trials

Place = tuple[str, str, int]  # kind, track, drones


@dataclass(frozen=True)
class Evidence:
    """Results by what they are of, each in order of seeds."""

    scale: Scale
    cells: dict[Place, tuple[Cell, ...]]
    meetings: dict[tuple[str, int], tuple[HeadToHead, ...]]  # by track and drones
    races: dict[Place, RaceLog]  # kept for the pictures
    trials: tuple[PolicyMeta, ...] = ()  # what was tried beside the plan

    def of(self, kind: str, track: str, drones: int) -> tuple[Cell, ...]:
        """A kind's cells, one per seed; none where it was not run."""
        return self.cells.get((kind, track, drones), ())

    def of_any(self, kind: str, track: str) -> tuple[Cell, ...]:
        """A kind's cells with the fewest drones that were run."""
        return next((cells for n in self.scale.drones if (cells := self.of(kind, track, n))), ())

    def summary(self, kind: str, track: str, drones: int) -> Summary | None:
        """A kind over its seeds; None where it was not run."""
        cells = self.of(kind, track, drones)
        return summarise_cells(cells, track_length(track)) if cells else None

    def stages(self, kind: str, track: str, drones: int) -> dict[int, Summary]:
        """After every stage; the last of several phases of a stage counts."""
        found: dict[int, dict[int, Any]] = {}
        for cell in self.of(kind, track, drones):
            for stage in cell.stages:
                found.setdefault(stage.stage, {})[cell.seed] = stage.measured
        return {
            stage: summarise(list(by_seed.values()), tuple(by_seed), track_length(track))
            for stage, by_seed in sorted(found.items())
        }

    def met(self, track: str, drones: int) -> tuple[HeadToHead, ...]:
        """The head-to-head races of so many drones, one per seed; none where they were not flown."""
        return self.meetings.get((track, drones), ())

    @property
    def all_cells(self) -> Iterator[Cell]:
        """Every cell."""
        for cells in self.cells.values():
            yield from cells


@functools.cache
def track_length(track: str) -> float:
    """Of the polygon through the gates [m]."""
    return lap_length(PAPER_TRACKS[track].gates)


def read_evidence(folder: ResultFolder, scale: Scale) -> Evidence:
    """Read a results folder. Raises CruiseError where a file is not a sound result, or of another scale."""
    results = [result for name in (CELLS, MEETINGS) for result in _results(folder, name)]
    strange = next((r for r in results if r.origin.scale != scale.name), None)
    if strange is not None:
        raise CruiseError(
            f"{folder.path} holds a result of the {strange.origin.scale} study ({strange.origin.command}), this is the "
            f"{scale.name} one: give another --results"
        )
    cells = [result for result in results if isinstance(result, Cell)]
    meetings = [result for result in results if isinstance(result, HeadToHead)]
    return Evidence(
        scale,
        _grouped(cells, lambda cell: (cell.kind, cell.track, cell.drones)),
        _grouped(meetings, lambda meeting: (meeting.track, meeting.drones)),
        dict(_races(folder, scale)),
        read_trials(folder.path),
    )


def _results(folder: ResultFolder, name: str) -> Iterator[Cell | HeadToHead]:
    for path in sorted((folder.path / name).glob("*.json")):
        result = folder.read(job_of(path))
        if result is not None:
            yield result


def job_of(path: Path) -> Job:
    """The job whose result a file's name says it is. Raises CruiseError where there is no such job."""
    for kind in KINDS:
        place, found, seed = path.stem.rpartition(f"-{kind}-s")
        track, _, drones = place.rpartition("-")
        if found and track in PAPER_TRACKS and drones.isdecimal() and seed.isdecimal():
            return Job(kind, track, int(drones), int(seed))
    raise CruiseError(f"result {path}: its name is not TRACK-DRONES-KIND-sSEED.json")


def _grouped(results: Sequence[Any], key: Any) -> dict[Any, tuple[Any, ...]]:
    groups: dict[Any, list[Any]] = {}
    for result in sorted(results, key=lambda r: r.seed):
        groups.setdefault(key(result), []).append(result)
    return {place: tuple(group) for place, group in groups.items()}


def _races(folder: ResultFolder, scale: Scale) -> Iterator[tuple[Place, RaceLog]]:
    for kind in KINDS:
        for track in scale.tracks:
            for drones in scale.drones:
                path = folder.race_of(Job(kind, track, drones, 0))
                if path.exists():
                    yield (kind, track, drones), load_race_log(path)


def mixed_settings(evidence: Evidence) -> list[str]:
    """Kinds whose cells were not all made with the same settings.

    Track, drones and seed apart, and what the plan lets depend on them: the planner's style, the boldness of learning,
    the share of sparring partners, the length of episodes.
    """
    first: dict[tuple[str, Any], dict[str, Any]] = {}
    mixed = {}
    for cell in evidence.all_cells:
        planner, usual = KINDS[cell.kind].family == "planner", evidence.scale.base(cell.drones)
        group = (cell.kind, cell.track if planner else replace(usual, drones=1))
        if not agree(first.setdefault(group, cell.config), cell.config, apart=("track", "drones", "seed")):
            mixed[cell.kind] = True
    return list(mixed)
