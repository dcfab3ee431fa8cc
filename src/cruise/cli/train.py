"""`cruise train`: train a policy through the curriculum, or resume a run."""

import dataclasses
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.constructors import PrimitiveConstructorSpec

from cruise.cli.compilation import prepare_training, start_jax
from cruise.cli.console import make_console
from cruise.cli.line_up import described
from cruise.cli.progress import make_screen
from cruise.cli.watch import Watch
from cruise.config import Track, TrainConfig
from cruise.errors import CruiseError
from cruise.presets import MAX_RANDOMISE, REWARDS, training_config, training_randomisation, with_one_learner
from cruise.racing.random_track import training_track
from cruise.racing.track_file import is_name
from cruise.vehicles import find_vehicle

MAX_EPISODES = 1_000_000


def checked_share(text: str) -> float:
    """The value of --randomise. Raises CruiseError where it is no share."""
    try:
        share = float(text)
    except ValueError:
        share = math.nan
    if not 0 <= share <= MAX_RANDOMISE:
        raise CruiseError(f"--randomise must be from 0 to {MAX_RANDOMISE:g}, not {text}")
    return share


SHARE: PrimitiveConstructorSpec = PrimitiveConstructorSpec(
    nargs=1,
    metavar="SHARE",
    instance_from_str=lambda words: checked_share(words[0]),
    is_instance=lambda thing: thing is None or isinstance(thing, float),
    str_from_instance=lambda share: [str(share)],
)


@dataclass(frozen=True)
class Train:
    """Train a policy by PPO, the five-stage curriculum and self-play."""

    config: TrainConfig = field(default_factory=TrainConfig)
    out: Path | None = None
    """Folder of the run; by default runs/TRACK-DRONES-sSEED."""
    resume: Annotated[Path | None, tyro.conf.arg(metavar="RUN_DIR")] = None
    """Continue the run in this folder; its own configuration holds, and other flags of the run are refused."""
    randomise: Annotated[float | None, described("SHARE"), SHARE] = None
    """Strength of the domain randomisation (0 to 2; 1 is all that a real drone may differ by); single flags such as
    --mass-spread override it. By default 0 for the paper's vehicle and 0.5 for others."""
    reward_preset: Literal["default", "paper"] = "default"
    """Reward weights: the project's, or those printed in the paper."""
    terms: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction, described("FILE.py")] = ()
    """Python file that declares observations and reward terms of your own; its code is run. Name the observation with
    --observation. All reward terms are added, or those of --reward-terms. Repeatable."""
    demonstrations: Annotated[Path | None, described("DIR")] = None
    """Start from a policy that flies as people did in the race logs of this folder (`cruise fly`): behaviour cloning,
    written as cloned.safetensors into the run's folder."""
    episodes: int = 100
    """Races in which the finished policy is measured."""
    devices: Annotated[int | None, described("N")] = None
    """How many devices (processor cores, GPUs) share the races. By default as many as can share them equally."""
    coordinator: Annotated[str | None, described("HOST:PORT")] = None
    """Train in several processes, on one machine or many, that meet here: at the first of them."""
    process: Annotated[str | None, described("I/N")] = None
    """With --coordinator: the number of this process, from 0, and how many there are."""

    watch: Watch = field(default_factory=Watch)

    @classmethod
    def usual(cls, asked: "Train") -> "Train":
        """The defaults, which the vehicle, the number of drones and the randomisation that were asked for decide.

        A policy that learning starts from, or flies against, decides what both networks observe: it knows nothing else.
        Where policies of before fly, or one with a memory learns, one drone of a race does.
        """
        vehicle = find_vehicle(asked.config.vehicle)
        config = training_config(vehicle, asked.config.drones)
        if asked.config.others_fly or asked.config.ppo.network == "gru":
            config = with_one_learner(config)
        others = (asked.config.start_from, asked.config.against, *asked.config.opponents.founders)
        if known := next(filter(None, others), ""):
            config = _seeing_as(known, config)
        if asked.demonstrations is not None:  # a clone's value network sees what it sees
            config = dataclasses.replace(config, critic_observation="")
        if asked.randomise is not None:
            config = dataclasses.replace(config, randomisation=training_randomisation(vehicle, asked.randomise))
        return cls(config=config)

    def run(self) -> int:
        """Train, measure, write the policy."""
        prepare_training()
        if self.coordinator or self.process:
            self._join()
        start_jax()
        from cruise.api_training import CURVES, finish_run  # noqa: PLC0415  (imports JAX, as the next five do)
        from cruise.pilots.terms_file import load_all_terms  # noqa: PLC0415
        from cruise.training.devices import choose_devices  # noqa: PLC0415
        from cruise.training.hosts import is_first  # noqa: PLC0415
        from cruise.training.run_track import TRACK, run_track  # noqa: PLC0415
        from cruise.training.session import Interrupted, Session, default_folder, resume_config  # noqa: PLC0415
        from cruise.training.validation import check_config  # noqa: PLC0415

        rewards = load_all_terms(self.terms)
        config = resume_config(self.resume) if self.resume else self._config(rewards)
        self._refuse_flags_with_resume()
        check_config(config)
        if not 1 <= self.episodes <= MAX_EPISODES:
            raise CruiseError(f"--episodes must be between 1 and {MAX_EPISODES}, not {self.episodes}")
        folder = self.resume or self.out or default_folder(config)
        devices = choose_devices(config.ppo.races, self.devices, config.learners)
        track = run_track(folder, config) if self.resume else training_track(config)
        if self.demonstrations is not None:
            config = self._imitate(folder, config, track)
        vehicle = find_vehicle(config.vehicle)
        session = Session(folder, config, track, vehicle, resume=bool(self.resume), devices=devices)
        try:
            with (
                self.watch.training(session) as offer,
                make_screen(make_console(quiet=not is_first()), config, session.trainer.total_steps) as screen,
            ):
                for progress in session:
                    screen.show(progress)
                    offer(progress)
            if not is_first():
                return 0
            policy = finish_run(session, self.episodes)
        except KeyboardInterrupt as stop:
            raise Interrupted(str(stop) or f"interrupted; go on with: {session.resume_command}") from None
        finally:
            session.close()
        where = f"--track {config.track if is_name(config.track) else folder / TRACK} --drones {config.drones}"
        print(f"policy   {policy}\ncurves   {folder / CURVES}")
        print(f"measure  cruise evaluate {where} --policy {policy}\nrace     cruise race {where} --policy {policy}")
        return 0

    def _imitate(self, folder: Path, config: TrainConfig, track: Track) -> TrainConfig:
        """The run, started from a clone of people."""
        from cruise.training.imitation import load_demonstrations, write_clone  # noqa: PLC0415  (imports JAX)
        from cruise.training.session import must_be_new  # noqa: PLC0415

        assert self.demonstrations is not None
        if config.start_from or self.coordinator:
            raise CruiseError("--demonstrations goes with neither --start-from nor --coordinator")
        must_be_new(folder)
        path, clone = write_clone(folder, config, track, load_demonstrations(self.demonstrations))
        print(
            f"cloned   {path}: {clone.samples} control steps, error {clone.error:.3f} (constant: {clone.scatter:.3f})"
        )
        return dataclasses.replace(config, start_from=str(path))

    def _join(self) -> None:
        """Meet the other processes of this run."""
        from cruise.training.hosts import join  # noqa: PLC0415  (imports JAX)

        if not (self.coordinator and self.process):
            raise CruiseError("--coordinator HOST:PORT and --process I/N go together")
        join(self.coordinator, self.process)

    def _config(self, rewards: tuple[str, ...]) -> TrainConfig:
        """The flags, with the reward terms that the files of --terms declare where none are named."""
        config = dataclasses.replace(self.config, reward_terms=self.config.reward_terms or rewards)
        if self.reward_preset == "default":
            return config
        if self.config.reward != training_config(self.config.vehicle).reward:
            raise CruiseError(
                "--reward-preset paper and single reward weights exclude each other: give one or the other"
            )
        return dataclasses.replace(config, reward=REWARDS[self.reward_preset])

    def _refuse_flags_with_resume(self) -> None:
        changed = self.config != TrainConfig() or self.randomise is not None or self.reward_preset != "default"
        changed = changed or self.demonstrations is not None
        if self.resume and (changed or self.out):
            raise CruiseError(
                "--resume continues a run as it was configured: leave out every flag but --episodes and --terms"
            )


def _seeing_as(policy: str, config: TrainConfig) -> TrainConfig:
    """With what a policy and its value network observed; where there is no such policy the run will say so."""
    from cruise.storage.policy_file import read_meta  # noqa: PLC0415  (imports JAX)

    try:
        meta = read_meta(policy)
    except CruiseError:
        return config
    return dataclasses.replace(config, observation=meta.observation, critic_observation=meta.critic_observation)
