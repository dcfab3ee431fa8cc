"""One tiny run that the tests of this folder share, compiled once per process."""

import copy
import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import PPOConfig, SelfPlayConfig, Track, TrainConfig, Vehicle
from cruise.env.types import RaceState, Rules
from cruise.pilots.network import ActorCritic
from cruise.presets import TRACKS, VEHICLES
from cruise.storage.checkpoint import load_meta
from cruise.training import session
from cruise.training.metrics_log import read_metrics
from cruise.training.session import Session
from cruise.training.trainer import Progress, Trainer

RACES, STEPS = 64, 16
PER_UPDATE = RACES * STEPS
TINY = TrainConfig(
    drones=2,
    step_scale=0.0012,
    episode_steps=24,
    checkpoint_seconds=1e9,
    ppo=PPOConfig(
        races=RACES,
        rollout_steps=STEPS,
        minibatches=4,
        hidden=(16, 16),
        average_updates=3,
        least_noise=0.7,
        company_distance=3.0,
    ),
    opponents=SelfPlayConfig(
        evaluate_every=4 * PER_UPDATE, evaluation_races=RACES, evaluation_steps=30, patience=1, sparring_share=0.3
    ),
)
ALL_LEARN = replace(TINY, drones=3, opponents=replace(TINY.opponents, learners="all", vary_field=True))
# The first from the command line.
_FLAGS = (
    "--drones 2 --step-scale 0.0012 --episode-steps 24 --races 64 --rollout-steps 16 --minibatches 4 --hidden 16 16 "
    "--average-updates 3 --least-noise 0.7 --company-distance 3 --evaluate-every 4096 "
    "--evaluation-races 64 --evaluation-steps 30 --patience 1 --learning-rate 1e-3 --final-learning-rate 1e-4 "
    "--gae-lambda 0.98 --initial-log-std -0.5 "
    "--entropy-weight 0.005 --entropy-hold 0 --entropy-end 1 --sparring-share 0.3"
)
TINY_FLAGS = _FLAGS.split()
UPDATES = 46  # 40 M steps * 0.0012 / 1024


@functools.cache
def tiny_trainer() -> Trainer:
    """The trainer of the tiny run."""
    return Trainer(TINY, TRACKS["ring"], VEHICLES["paper"])


def shared_trainer(
    config: TrainConfig,
    track: Track = TRACKS["ring"],
    vehicle: Vehicle = VEHICLES["paper"],
    devices: Sequence[jax.Device] | None = None,
) -> Trainer:
    """A trainer for another seed, checkpoint interval or beginning, which runs the programs of the tiny run."""
    same = {name: getattr(TINY, name) for name in ("seed", "checkpoint_seconds", "start_from", "against")}
    assert replace(config, **same) == TINY
    assert (track, vehicle) == (TRACKS["ring"], VEHICLES["paper"])
    assert devices is None or list(devices) == list(tiny_trainer().mesh.devices)
    trainer = copy.copy(tiny_trainer())
    trainer.config = config
    return trainer


@functools.cache
def whole_run(seed: int = 0) -> tuple[Progress, ...]:
    """Every update of a run that nothing interrupts."""
    trainer = shared_trainer(replace(TINY, seed=seed))
    return tuple(trainer.run(trainer.initial_state()))


@pytest.fixture
def open_session(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Session]:
    """Opens a run in `tmp_path / "run"` on programs that are compiled already."""
    monkeypatch.setattr(session, "Trainer", shared_trainer)

    def open_it(
        seconds: float = 1e9, *, folder: Path = tmp_path / "run", resume: bool = False, **policies: str
    ) -> Session:
        config = replace(TINY, checkpoint_seconds=seconds, **policies)
        return Session(folder, config, TRACKS["ring"], VEHICLES["paper"], resume=resume)

    return open_it


def saved_updates(folder: Path) -> int:
    """How far the newest checkpoint of a run is."""
    return load_meta(folder)["steps"] // PER_UPDATE


def bits(tree: object) -> list[bytes]:
    """Every array of a pytree, byte for byte."""
    plain = jax.tree.map(lambda x: jax.random.key_data(x) if jnp.issubdtype(x.dtype, jax.dtypes.prng_key) else x, tree)
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(plain)]


def random_model(seed: int, model: ActorCritic, scale: float = 0.5) -> ActorCritic:
    """Other parameters of the same shapes, large enough that actions differ."""
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda x: jnp.asarray(rng.normal(scale=scale, size=x.shape), jnp.float32), model)


def last_rules() -> Rules:
    """Of the last stage, where every collision ends the episode."""
    trainer = tiny_trainer()
    return trainer.rules_of(trainer.phases[-1])


def moving(races: RaceState, seed: int) -> RaceState:
    """The same races with drones that have been thrown, mostly down, so that some soon crash."""
    rng = np.random.default_rng(seed)
    body = races.drones.body
    thrown = rng.normal(scale=5.0, size=body.velocity_w.shape)
    thrown[2] -= 5.0
    thrown = jnp.asarray(thrown, jnp.float32)
    return races._replace(drones=races.drones._replace(body=body._replace(velocity_w=thrown)))


def train(session: Session, updates: int | None = None) -> None:
    """Train to the end, or for so many updates and then drop everything, as a crash would."""
    for _ in itertools.islice(session, updates):
        pass


def rows_of(session: Session) -> list[dict]:
    """Everything logged but the clock."""
    return [{k: v for k, v in row.items() if k != "seconds"} for row in read_metrics(session.folder)]


@pytest.fixture
def uninterrupted(open_session: Callable[..., Session], tmp_path: Path) -> Session:
    """A run to its end."""
    session = open_session(folder=tmp_path / "uninterrupted")
    train(session)
    return session
