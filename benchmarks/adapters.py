"""The environment through the interfaces of Gymnasium and PettingZoo, NumPy arrays in and out."""

from typing import Any

import numpy as np

import cruise
from benchmarks.environment import TRACK
from cruise.adapters.gymnasium_env import RaceEnv
from cruise.adapters.gymnasium_vector import VectorRaceEnv

RACES, DRONES = 1024, 4
STEPS = 50  # per call
OPPONENTS = "chaser"
INTERFACES = ("Gymnasium, single", "Gymnasium, vector", "PettingZoo, single", "PettingZoo, vector")


class InterfaceCase:
    """Random actions through an interface, episodes that end begun anew. Its unit is the step of one drone."""

    def __init__(self, interface: str, races: int = RACES, drones: int = DRONES, steps: int = STEPS) -> None:
        """Build the environment and step it once, which compiles."""
        self.interface, self.steps = interface, steps
        self.races = races if interface.endswith("vector") else 1
        self.work = float(self.races * drones * steps)
        random = np.random.default_rng(0)
        self._actions = random.uniform(-1.0, 1.0, (steps, self.races, drones, 3)).astype(np.float32)
        self.env: Any = self._built(drones)
        self.env.reset(seed=0)
        self._step(self._actions[0])

    def __call__(self) -> None:
        """Step all races `steps` times."""
        for actions in self._actions:
            self._step(actions)

    def _built(self, drones: int) -> Any:
        versus = {"track": TRACK, "drones": drones, "opponents": OPPONENTS}
        if self.interface == "Gymnasium, single":
            return RaceEnv(**versus)
        if self.interface == "Gymnasium, vector":
            return VectorRaceEnv(self.races, **versus)
        if self.interface == "PettingZoo, single":
            return cruise.parallel_env(track=TRACK, drones=drones)
        return cruise.vector_parallel_env(self.races, track=TRACK, drones=drones)

    def _step(self, actions: np.ndarray) -> None:
        """[E, N, A]; the drones that learn take theirs."""
        if self.interface == "Gymnasium, single":
            _, _, terminated, truncated, _ = self.env.step(actions[0, 0])
            if terminated or truncated:
                self.env.reset()
        elif self.interface == "Gymnasium, vector":
            self.env.step(actions[:, 0])
        elif self.interface == "PettingZoo, single":
            self.env.step({agent: actions[0, k] for k, agent in enumerate(self.env.agents)})
            if not self.env.agents:
                self.env.reset()
        else:
            self.env.step({agent: actions[:, k] for k, agent in enumerate(self.env.agents)})
