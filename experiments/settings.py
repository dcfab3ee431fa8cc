"""What a result depends on beside its seeds, and whether two results were made alike."""

from typing import Any

from cruise.pilots.se_ibr.settings import Setting, style_of
from cruise.racing.track_file import load_track
from cruise.storage.config_file import to_data
from cruise.vehicles import find_vehicle
from experiments.plan import Job, Scale, config_of
from experiments.results import Cell

PLANNERS: dict[str, Setting] = {"se-ibr": "paper", "se-ibr-tuned": "tuned"}
# Fields of a configuration that change nothing in what is learned.
IMMATERIAL = ("checkpoint_seconds",)
# Options since which every policy learns and sees otherwise, whatever their value.
ERAS = ("sparring_share",)


def settings_of(job: Job, scale: Scale) -> dict[str, Any]:
    """What a job's cell depends on beside the seeds: the resolved configuration, or how the planner flies a track."""
    if job.family == "planner":
        style = style_of(PLANNERS[job.kind], load_track(job.track), find_vehicle(scale.base(job.drones).vehicle))
        return {name: float(value) for name, value in style._asdict().items()}
    return to_data(config_of(job, scale))


def is_current(cell: Cell, job: Job, scale: Scale) -> bool:
    """Whether a cell was made with the settings that the plan has today."""
    return agree(cell.config, settings_of(job, scale))


def agree(one: dict[str, Any], other: dict[str, Any], apart: tuple[str, ...] = ()) -> bool:
    """Whether two results were made with the same settings, but for the fields `apart`.

    Fields that one of the two does not know are no difference: a program that has grown an option still knows the
    results from before, which had none. But for those that mark an era.
    """
    if any((era in one) != (era in other) for era in ERAS):
        return False
    shared = [key for key in one if key in other and key not in (*IMMATERIAL, *apart)]
    return all(
        agree(one[key], other[key]) if isinstance(one[key], dict) else _plain(one[key]) == _plain(other[key])
        for key in shared
    )


def _plain(value: Any) -> Any:
    """Lists and tuples alike, as JSON has them."""
    return list(value) if isinstance(value, tuple) else value
