"""The search for a recipe: settings drawn by Ray Tune, each tried on several tracks and seeds, the worst stopped early.

What is compared is how drones race, lap times and crashes, never the reward, whose weights are searched too.
"""

import dataclasses
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from cruise.config import TrainConfig
from cruise.errors import CruiseError
from cruise.racing.random_track import training_track
from cruise.storage.checkpoint import load_checkpoint, save_checkpoint
from cruise.training.initial_state import initial_state
from cruise.training.self_play import Score
from cruise.training.trainer import Progress, Trainer, TrainingDiverged
from cruise.training.types import TrainState
from cruise.training.validation import check_config
from cruise.vehicles import find_vehicle

Settings = Mapping[str, Any]  # values by the name of their field in `TrainConfig` or in one of its parts
PARTS = ("reward", "ppo", "opponents")
CRASH = 2.0  # what a crash in every race costs, as the logarithm of the lap time: one in a hundred is 2 % of a lap
HOPELESS = 5.0  # beside it, where no lap is flown at all
DIVERGED = 100.0  # cost of what cannot be trained with


class Range(NamedTuple):
    """Numbers between two bounds, evenly or by their logarithms."""

    low: float
    high: float
    log: bool = False


# What is searched unless somebody names other fields. Nothing that changes the shape of the networks.
SPACE: dict[str, Range | tuple[Any, ...]] = {
    "learning_rate": Range(3e-4, 3e-3, log=True),
    "final_learning_rate": Range(1e-5, 3e-4, log=True),
    "epochs": (1, 2, 3, 4),
    "minibatches": (8, 16, 32),
    "gamma": (0.99, 0.993, 0.995, 0.997),
    "gae_lambda": (0.9, 0.95, 0.97, 0.98, 0.99),
    "clip_ratio": Range(0.1, 0.3),
    "entropy_weight": (0.0, 0.001, 0.003, 0.01),
    "retry_share": (0.0, 0.25, 0.5, 0.75),
    "terminal": Range(-40.0, -4.0),
    "gate_bonus": Range(0.0, 3.0),
    "w_edge": Range(2.0, 40.0, log=True),
    "edge_margin": Range(0.1, 0.35),
}


@dataclass(frozen=True)
class Search:
    """What is tried, and how long."""

    config: TrainConfig  # what settings are put into; its track and seed are not looked at
    tracks: tuple[str, ...]
    seeds: tuple[int, ...] = (0,)
    rungs: int = 4  # times that a trial is looked at, evenly over its training
    samples: int = 16  # trials
    scheduler: Literal["asha", "pbt"] = "asha"


def applied(config: TrainConfig, settings: Settings) -> TrainConfig:
    """The configuration with these settings in place of its own. Raises CruiseError where it has no such field."""
    for name, value in settings.items():
        home = next((part for part in ("", *PARTS) if name in _fields(config, part)), None)
        if home is None:
            raise CruiseError(f"no field {name!r} to search: `cruise train --help` has them all")
        if home:
            config = dataclasses.replace(config, **{home: dataclasses.replace(getattr(config, home), **{name: value})})
        else:
            config = dataclasses.replace(config, **{name: value})
    return config


def _fields(config: TrainConfig, part: str) -> list[str]:
    return [field.name for field in dataclasses.fields(getattr(config, part) if part else config)]


def usual_settings(config: TrainConfig, names: Iterator[str] | list[str]) -> dict[str, Any]:
    """What a configuration says of these fields."""
    owners = (config, *(getattr(config, part) for part in PARTS))
    return {name: next(getattr(owner, name) for owner in owners if hasattr(owner, name)) for name in names}


def cost_of(score: Score, horizon: float) -> float:
    """What the search makes small: the logarithm of the lap time [s], so that no track outweighs another, and crashes.

    `horizon` is how long an evaluation lasts [s]: a lap takes at least that where none was flown.
    """
    crashes = CRASH * (1.0 - float(score.success))
    lap = float(score.lap_time)
    return (math.log(lap) if math.isfinite(lap) else math.log(horizon) + HOPELESS) + crashes


class Trial:
    """One set of settings in training: a run for every track and seed, all as far as each other."""

    def __init__(self, search: Search, settings: Settings) -> None:
        """Build the runs. Raises CruiseError where the settings do not go together."""
        self.search, self.rung = search, 0
        self.trainers: dict[str, Trainer] = {}
        for track in search.tracks:
            for seed in search.seeds:
                config = dataclasses.replace(applied(search.config, settings), track=track, seed=seed)
                check_config(config)
                self.trainers[f"{track}-{seed}"] = Trainer(config, training_track(config), find_vehicle(config.vehicle))
        self.states = {name: initial_state(trainer) for name, trainer in self.trainers.items()}
        self._under_way: dict[str, Iterator[Progress]] = {}

    def advance(self) -> dict[str, float]:
        """Train every run up to the next rung: gives `cost`, and lap [s] and success of every run."""
        self.rung += 1
        scores = {name: self._train(name) for name in self.trainers}
        costs = [
            cost_of(score, self.search.config.opponents.evaluation_steps * self.trainers[name].env.dynamics.control_dt)
            for name, score in scores.items()
        ]
        told = {f"{name}/lap": float(score.lap_time) for name, score in scores.items()}
        told |= {f"{name}/success": float(score.success) for name, score in scores.items()}
        return {"cost": float(np.mean(costs)), **told}

    def _train(self, name: str) -> Score:
        trainer = self.trainers[name]
        until = math.ceil(trainer.total_updates * self.rung / self.search.rungs)
        progress = self._under_way.setdefault(name, trainer.run(self.states[name]))
        while int(self.states[name].updates) < until:
            self.states[name] = next(progress).state
        return self._measured(trainer, self.states[name])

    @staticmethod
    def _measured(trainer: Trainer, state: TrainState) -> Score:
        """Under the rules of the last phase, whichever the training has come to."""
        last = trainer.phases[-1]
        origin = np.array([trainer.config.seed, int(state.updates)], np.uint32)
        rules, alone = trainer.rules_of(last), np.asarray(last.alone)
        score: Score = trainer.evaluate(state.policy, state.opponents.newest, rules, alone, origin, state.league)
        return score

    def save(self, folder: Path) -> None:
        """Write all runs."""
        for name, state in self.states.items():
            (folder / name).mkdir()
            save_checkpoint(folder / name, state, {"rung": self.rung})

    def load(self, folder: Path) -> None:
        """Go on from what `save` wrote, of these settings or of others."""
        for name, trainer in self.trainers.items():
            state, told = load_checkpoint(folder / name, trainer.state_shape())
            self.states[name], self.rung = trainer.place(state), int(told["rung"])
        self._under_way.clear()


def try_settings(settings: Settings, search: Search, prepare: Callable[[], None]) -> None:
    """What a worker of Ray Tune runs: trains, reports at every rung, goes on where it was stopped."""
    from ray import tune  # noqa: PLC0415  (an extra)

    prepare()
    try:
        trial = Trial(search, settings)
        if checkpoint := tune.get_checkpoint():
            with checkpoint.as_directory() as folder:
                trial.load(Path(folder))
        while trial.rung < search.rungs:
            told = trial.advance()
            with tempfile.TemporaryDirectory() as folder:
                trial.save(Path(folder))
                tune.report(told, checkpoint=tune.Checkpoint.from_directory(folder))
    except TrainingDiverged:
        tune.report({"cost": DIVERGED})
