"""`cruise train`: train a policy through the curriculum, or resume a run."""

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from cruise.cli.compilation import prepare_training
from cruise.cli.line_up import described
from cruise.cli.progress import make_screen
from cruise.config import RewardWeights, TrainConfig
from cruise.errors import CruiseError
from cruise.presets import REWARDS, VEHICLES
from cruise.racing.track_file import load_track

MAX_EPISODES = 1_000_000


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
    devices: Annotated[int | None, described("N")] = None
    """How many devices (processor cores, GPUs) share the races. By default as many as can share them equally."""

    def run(self) -> int:
        """Train, measure, write the policy."""
        prepare_training()
        from cruise.api_training import CURVES, finish_run  # noqa: PLC0415  (imports JAX, as the next three do)
        from cruise.training.devices import choose_devices  # noqa: PLC0415
        from cruise.training.session import Interrupted, Session, default_folder, resume_config  # noqa: PLC0415
        from cruise.training.validation import check_config  # noqa: PLC0415

        config = resume_config(self.resume) if self.resume else self._config()
        self._refuse_flags_with_resume()
        check_config(config)
        if not 1 <= self.episodes <= MAX_EPISODES:
            raise CruiseError(f"--episodes must be between 1 and {MAX_EPISODES}, not {self.episodes}")
        folder = self.resume or self.out or default_folder(config)
        devices = choose_devices(config.ppo.races, self.devices)
        track, vehicle = load_track(config.track), VEHICLES[config.vehicle]
        session = Session(folder, config, track, vehicle, resume=bool(self.resume), devices=devices)
        try:
            with make_screen(Console(), config, session.trainer.total_steps) as screen:
                for progress in session:
                    screen.show(progress)
            policy = finish_run(session, self.episodes)
        except KeyboardInterrupt as stop:
            raise Interrupted(str(stop) or f"interrupted; go on with: {session.resume_command}") from None
        where = f"--track {config.track} --drones {config.drones}"
        print(f"policy   {policy}\ncurves   {folder / CURVES}")
        print(f"measure  cruise evaluate {where} --policy {policy}\nrace     cruise race {where} --policy {policy}")
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
