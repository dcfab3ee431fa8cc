"""Races of the policy that is being trained, flown beside the training for those who watch."""

import math
import queue
import threading
import time
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import Track, TrainConfig, Vehicle
from cruise.env.race_env import make_race_env
from cruise.env.types import race_rules
from cruise.pilots.network import ActorCritic
from cruise.pilots.neural import NeuralPilot
from cruise.rollout import fly
from cruise.storage.race_log import RaceLog
from cruise.storage.recorder import RaceInfo, race_logs
from cruise.training.trainer import Progress
from cruise.viewer.broadcast import Broadcast
from cruise.viewer.packing import pack_race

PAUSE = 5.0  # between two races, at least [s]
SHARE = 0.02  # of one core's time that races may take at most
HELPERS = 2.0  # a race takes less than so many times what its own thread does; JAX has helpers
LAPS = 1
TIME_LIMIT = 25.0  # of a race [s]
STATUS_EVERY = 1.0  # [s]
LOOK = 0.5  # how often to look whether somebody watches [s]


class _Offer(NamedTuple):
    """What a race needs of the training."""

    model: ActorCritic  # on the host
    agility: float
    label: str
    number: int  # of the update


class TrainingRaces:
    """Flies a race of the current policy now and then, in a thread of its own, and publishes it.

    Nothing is flown while nobody listens. A race is asked for, taken from the next update, and flown on the processor
    while the training goes on; the pause after it is so long that races take at most `SHARE` of a core. All races share
    one compiled program, whatever the stage.
    """

    def __init__(
        self, broadcast: Broadcast, config: TrainConfig, track: Track, vehicle: Vehicle, total_steps: int
    ) -> None:
        """Start to wait for listeners."""
        self.broadcast, self.config, self.track, self.vehicle = broadcast, config, track, vehicle
        self.total_steps = total_steps
        self._told, self._score = -math.inf, ""
        self.env = make_race_env(track, config.drones, vehicle, config.observation)
        self._asked, self._stopped = threading.Event(), threading.Event()
        self._offers: queue.SimpleQueue[_Offer | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="races to watch", daemon=True)
        self._thread.start()

    def offer(self, progress: Progress) -> None:
        """Take notice of an update: nearly always nothing but a look at the clock and a flag."""
        self._tell(progress)
        if not self._asked.is_set():
            return
        self._asked.clear()
        phase = progress.phase
        self._offers.put(
            _Offer(
                model=jax.tree.map(np.asarray, progress.state.policy),
                agility=phase.stage.agility,
                label=f"stage {phase.number}, {progress.steps / 1e6:.2f} M steps",
                number=int(progress.state.updates),
            )
        )

    def _tell(self, progress: Progress) -> None:
        """Say where the training stands, once in a while."""
        score, now = progress.score, time.monotonic()
        if score is not None:
            lap = "" if math.isnan(score.lap_time) else f", lap {score.lap_time:.2f} s"
            self._score = f"; last evaluation: success {score.success:.0%}{lap}"
        if now - self._told < STATUS_EVERY:
            return
        self._told = now
        steps = f"{progress.steps / 1e6:.1f} of {self.total_steps / 1e6:.1f} M steps"
        stage = f"stage {progress.phase.number} {progress.phase.stage.name}"
        self.broadcast.publish("status", {"text": f"Training: {stage}, {steps}{self._score}"})

    def close(self) -> None:
        """Fly no more."""
        self._stopped.set()
        self._offers.put(None)
        self._thread.join()

    def _work(self) -> None:
        try:
            self._fly_races()
        except Exception as error:  # whatever happens here, the training goes on
            self.broadcast.publish("status", {"text": f"The live view has failed: {error}"})

    def _fly_races(self) -> None:
        compiled = False
        while not self._stopped.is_set():
            if not self.broadcast.wait_for_listener(LOOK):
                continue
            self._asked.set()
            offer = self._offers.get()
            if offer is None:
                return
            started = time.thread_time()
            log = self.fly(offer.model, offer.agility, offer.number)
            self.broadcast.publish("race", pack_race(log, offer.label))
            spent = HELPERS * (time.thread_time() - started)
            self._stopped.wait(max(PAUSE, spent / SHARE) if compiled else PAUSE)
            compiled = True

    def fly(self, model: ActorCritic, agility: float, seed: int) -> RaceLog:
        """One race of a model against itself, from a random start, under the rules of a real race."""
        with jax.default_device(_processor()):
            return self._fly(model, agility, seed)

    def _fly(self, model: ActorCritic, agility: float, seed: int) -> RaceLog:
        pilot = NeuralPilot(
            params=jax.tree.map(jnp.asarray, model),
            observation=self.config.observation,
            drones=self.config.drones,
            agility=1.0,  # static; the rules carry the stage's
            name="policy",
            vehicle=self.vehicle.name,
        )
        distance = self.vehicle.collision_distance
        rules: Any = race_rules(jnp.float32(agility), distance, self.track.gates_to_finish(LAPS))
        rules = jax.tree.map(jnp.asarray, rules)
        steps = round(TIME_LIMIT / self.env.dynamics.control_dt)
        flight = fly(self.env, (pilot,) * self.config.drones, rules, jax.random.key(seed), steps, (1,))
        names = (pilot.name,) * self.config.drones
        return race_logs(flight, RaceInfo(self.track, LAPS, (self.vehicle.name,), distance, names))[0]


def _processor() -> jax.Device | None:
    """Where races are flown: not where the training has its own to do, if that is elsewhere."""
    try:
        return jax.local_devices(backend="cpu")[-1]
    except RuntimeError:  # JAX was told to leave the processor alone
        return None
