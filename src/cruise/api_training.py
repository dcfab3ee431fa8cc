"""Training from Python. Apart from `cruise.api`, so that racing does not wait for the learner's libraries."""

import os
from collections.abc import Callable
from pathlib import Path

from cruise.config import TrainConfig
from cruise.evaluation.matches import evaluate_policy
from cruise.pilots.neural import NeuralPilot
from cruise.precision import single_precision
from cruise.processor import use_wide_vectors
from cruise.racing.random_track import training_track, unseen_tracks
from cruise.racing.track_file import RANDOM_KINDS
from cruise.report.training_figure import draw_training
from cruise.storage.policy_file import load_policy
from cruise.training.devices import use_cores
from cruise.training.metrics_log import read_metrics
from cruise.training.session import Session, default_folder
from cruise.training.trainer import Progress
from cruise.training.validation import check_config, owning_vehicle
from cruise.vehicles import find_vehicle

__all__ = ["finish_run", "train"]

CURVES = "training.png"  # learning curves in the folder of a run


@single_precision
def train(
    config: TrainConfig | None = None,
    out: str | os.PathLike[str] | None = None,
    *,
    episodes: int = 100,
    show: Callable[[Progress], None] | None = None,
) -> NeuralPilot:
    """Train a policy through the curriculum and give it, ready to race.

    Args:
        config: what to train; by default four drones on the ring, the paper's 40 million steps.
        out: folder of the run, new; by default `runs/TRACK-DRONES-sSEED`. `cruise train --resume` continues it.
        episodes: races in which the finished policy is measured.
        show: called after every update.

    Raises:
        CruiseError: the configuration cannot work, the folder holds a run already, or training diverged.
    """
    config = owning_vehicle(config or TrainConfig())
    check_config(config)
    use_wide_vectors()
    use_cores()
    folder = Path(out) if out else default_folder(config)
    session = Session(folder, config, training_track(config), find_vehicle(config.vehicle))
    try:
        for progress in session:
            if show:
                show(progress)
        return load_policy(finish_run(session, episodes))
    finally:
        session.close()


def finish_run(session: Session, episodes: int) -> Path:
    """Measure the policy of a run that has ended, write it with its results, draw the curves; give its path."""
    kind, sensing = session.config.track, session.config.sensing
    track = unseen_tracks(kind) if kind in RANDOM_KINDS else session.track  # never those it was trained on
    path = session.finish(lambda policy: evaluate_policy(policy, track, episodes, sensing=sensing))
    title = f"{session.track.name}, {session.config.drones} drones, seed {session.config.seed}"
    draw_training(read_metrics(session.folder), title, session.folder / CURVES)
    return path
