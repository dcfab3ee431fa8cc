"""Ray Tune around the trials: who is tried, who is stopped, what is kept on disk."""

import contextlib
import importlib
import json
import logging
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from cruise.errors import CruiseError, one_line
from cruise.extras import import_extra
from cruise.storage.atomic import write_atomically
from cruise.training.tuning import SPACE, Range, Search, try_settings, usual_settings

RECORD, BEST = "trials.jsonl", "best.json"
TOLD = 300  # characters of what went wrong


class Tried(NamedTuple):
    """How a trial ended."""

    settings: dict[str, Any]
    rungs: int  # that it came to
    told: dict[str, float]  # `cost`, and laps and successes


def search_space(names: tuple[str, ...]) -> dict[str, Range | tuple[Any, ...]]:
    """The part of the space with these names; all of it without any. Raises CruiseError where one is not in it."""
    for name in names:
        if name not in SPACE:
            raise CruiseError(f"{name!r} is not searched; these are: {', '.join(SPACE)}")
    return {name: SPACE[name] for name in names or SPACE}


def find_recipe(
    search: Search,
    folder: Path,
    names: tuple[str, ...],
    prepare: Callable[[], None],
    *,
    address: str | None = None,
    at_once: int | None = None,
    resume: bool = False,
) -> list[Tried]:
    """Search, and write what was found into `folder`; the trials, the best first.

    The first trial is the configuration as it is. Whatever stops the search, `resume` goes on with it.

    Raises:
        CruiseError: Ray is not installed or does not start, the folder holds a search already or none to resume, or
            no trial came to an end.
    """
    import_extra("ray.tune", "tune", "the search needs Ray Tune")
    tune = importlib.import_module("ray.tune")
    holds = (folder / "tuner.pkl").exists()
    if resume != holds:
        raise CruiseError(
            f"{folder}: no search to resume here" if resume else f"{folder} holds a search already: give --resume"
        )
    with _ray(address):
        trainable = tune.with_parameters(try_settings, search=search, prepare=prepare)
        trainable = tune.with_resources(trainable, {"cpu": 1})
        if resume:
            tuner = tune.Tuner.restore(str(folder.absolute()), trainable, resume_unfinished=True, restart_errored=True)
        else:
            tuner = _new_tuner(tune, trainable, search, folder, names, at_once)
        found = [*_tried(tuner.fit())]
    if not found:
        raise CruiseError(f"no trial of {folder} came to an end: see the error files there")
    _write(folder, found)
    return found


def _new_tuner(
    tune: Any, trainable: Any, search: Search, folder: Path, names: tuple[str, ...], at_once: int | None
) -> Any:
    space = search_space(names)
    drawn = {name: _domain(tune, choice) for name, choice in space.items()}
    usual = usual_settings(search.config, list(space))
    basic = importlib.import_module("ray.tune.search.basic_variant").BasicVariantGenerator
    return tune.Tuner(
        trainable,
        param_space=drawn,
        tune_config=tune.TuneConfig(
            metric="cost",
            mode="min",
            num_samples=search.samples,
            max_concurrent_trials=at_once,
            search_alg=basic(points_to_evaluate=[usual], max_concurrent=at_once or 0, random_state=search.config.seed),
            scheduler=_scheduler(search, drawn),
        ),
        run_config=tune.RunConfig(
            name=folder.name,
            storage_path=str(folder.absolute().parent),
            verbose=0,
            checkpoint_config=tune.CheckpointConfig(num_to_keep=1),
        ),
    )


def _scheduler(search: Search, drawn: dict[str, Any]) -> Any:
    """ASHA (Li et al., MLSys 2020) stops the worst at each rung, PBT (Jaderberg et al., 2017) copies the best."""
    schedulers = importlib.import_module("ray.tune.schedulers")
    if search.scheduler == "pbt":
        return schedulers.PopulationBasedTraining(
            perturbation_interval=1, hyperparam_mutations=drawn, require_attrs=False
        )
    return schedulers.ASHAScheduler(max_t=search.rungs, grace_period=1, reduction_factor=3)


def _domain(tune: Any, choice: Range | tuple[Any, ...]) -> Any:
    if not isinstance(choice, Range):
        return tune.choice(list(choice))
    return (tune.loguniform if choice.log else tune.uniform)(choice.low, choice.high)


@contextlib.contextmanager
def _ray(address: str | None) -> Iterator[None]:
    """Ray on this machine, or of a cluster, or as it runs already. Raises CruiseError where it does not start."""
    ray = importlib.import_module("ray")
    if ray.is_initialized():
        yield
        return
    logging.getLogger("ray").setLevel(logging.ERROR)
    os.environ.setdefault("RAY_AIR_NEW_OUTPUT", "0")
    os.environ.setdefault("TUNE_DISABLE_AUTO_CALLBACK_LOGGERS", "1")
    local = {"include_dashboard": False} if address is None else {"address": address}
    try:
        ray.init(log_to_driver=False, logging_level="ERROR", configure_logging=False, **local)
    except Exception as error:  # Ray's own are of no narrower class
        raise CruiseError(f"Ray does not start: {one_line(error, TOLD)}") from None
    try:
        yield
    finally:
        ray.shutdown()


def _tried(results: Any) -> list[Tried]:
    """What the trials that were measured at all came to: those that went farthest first, the best of them first."""
    ended = [one for one in results if one.metrics and "cost" in one.metrics]
    tried = [Tried(dict(one.config), int(one.metrics["training_iteration"]), _plain(one.metrics)) for one in ended]
    return sorted(tried, key=lambda one: (-one.rungs, one.told["cost"]))


def _plain(metrics: dict[str, Any]) -> dict[str, float]:
    """What a trial told, but for laps that nobody flew."""
    names = [name for name in metrics if name == "cost" or name.endswith(("/lap", "/success"))]
    return {name: float(metrics[name]) for name in names if math.isfinite(metrics[name])}


def _write(folder: Path, found: list[Tried]) -> None:
    lines = [json.dumps(one._asdict()) + "\n" for one in found]
    write_atomically(folder / RECORD, "".join(lines).encode())
    write_atomically(folder / BEST, (json.dumps(found[0]._asdict(), indent=2) + "\n").encode())


def best_of(search: Search, found: list[Tried]) -> str:
    """The flags of `cruise train` that the best trial differs by from the configuration that was searched around."""
    usual = usual_settings(search.config, list(found[0].settings))
    changed = {name: value for name, value in found[0].settings.items() if value != usual[name]}
    return " ".join(f"--{name.replace('_', '-')} {value:.3g}" for name, value in changed.items())
