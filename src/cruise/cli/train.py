"""`cruise train`: train a policy through the curriculum, or resume a run."""

import dataclasses
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from cruise.cli.progress import Screen, make_screen
from cruise.config import RewardWeights, TrainConfig
from cruise.errors import CruiseError
from cruise.presets import REWARDS, VEHICLES
from cruise.racing.track_file import load_track


@dataclass(frozen=True)
class Train:
    """Train a policy by PPO, the five-stage curriculum and self-play."""

    config: TrainConfig = field(default_factory=TrainConfig)
    out: Path | None = None
    """Folder of the run; by default runs/TRACK-DRONES-sSEED."""
    resume: Annotated[Path | None, tyro.conf.arg(metavar="RUN_DIR")] = None
    """Continue the run in this folder; its own configuration holds, and other flags of the run are refused."""
    reward_preset: Literal["default", "paper"] = "default"
    """Reward weights: the project's, or those printed in the paper."""
    episodes: int = 100
    """Races in which the finished policy is measured."""

    def run(self) -> int:
        """Train, measure, write the policy."""
        _use_compilation_cache()
        from cruise.training.session import Session, resume_config  # noqa: PLC0415  (imports JAX)
        from cruise.training.validation import check_config  # noqa: PLC0415

        config = resume_config(self.resume) if self.resume else self._config()
        self._refuse_flags_with_resume()
        check_config(config)
        if self.episodes < 1:
            raise CruiseError(f"--episodes must be 1 or more, not {self.episodes}")
        folder = self.resume or self.out or Path("runs") / _default_name(config)
        session = Session(folder, config, load_track(config.track), VEHICLES[config.vehicle], resume=bool(self.resume))
        with make_screen(Console(), config, session.trainer.total_steps) as screen:
            _train(session, screen)
        _finish(session, self.episodes)
        return 0

    def _config(self) -> TrainConfig:
        if self.reward_preset == "default":
            return self.config
        if self.config.reward != RewardWeights():
            raise CruiseError(
                "--reward-preset paper and single reward weights exclude each other: give one or the other"
            )
        return dataclasses.replace(self.config, reward=REWARDS[self.reward_preset])

    def _refuse_flags_with_resume(self) -> None:
        if self.resume and (self.config != TrainConfig() or self.out or self.reward_preset != "default"):
            raise CruiseError("--resume continues a run as it was configured: leave out every flag but --episodes")


def _use_compilation_cache() -> None:
    """Compiled programs are kept between runs, so that only the first start on a machine is slow."""
    import jax  # noqa: PLC0415

    if jax.config.jax_compilation_cache_dir is None:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        jax.config.update("jax_compilation_cache_dir", str(Path(base) / "cruise" / "jax"))


def _default_name(config: TrainConfig) -> str:
    kind = "-vanilla" if config.vanilla else ""
    return f"{Path(config.track).stem}-{config.drones}{kind}-s{config.seed}"


def _train(session: Any, screen: Screen) -> None:
    for progress in session:
        screen.show(progress)


def _finish(session: Any, episodes: int) -> None:
    """Measure the final policy, write it with its results, draw the curves."""
    from cruise.evaluation.matches import evaluate_policy  # noqa: PLC0415
    from cruise.report.training_figure import draw_training  # noqa: PLC0415
    from cruise.training.session import read_metrics  # noqa: PLC0415

    path = session.finish(lambda policy: evaluate_policy(policy, session.track, episodes))
    picture = session.folder / "training.png"
    draw_training(read_metrics(session.folder), f"{session.track.name}, {session.config.drones} drones", picture)
    print(
        f"policy   {path}\ncurves   {picture}\nmeasure  cruise evaluate --policy {path}\nrace     cruise race --policy {path}"
    )
