"""One race with people in it, step by step: what they tell their drones, and what their pages are told."""

from typing import Any

import equinox as eqx
import jax
import numpy as np

from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.evaluation.matches import Match
from cruise.human.order import Happened, Order
from cruise.pilots.human import Controls, HumanPilot
from cruise.rollout import RunningRace, start_races, team_rules
from cruise.storage.race_log import RaceLog
from cruise.storage.recorder import race_logs
from cruise.viewer.samples import quaternions

BATCH = (1,)  # race logs are made of batches


class LiveRace:
    """A race of a match whose first drones are flown by people."""

    def __init__(self, match: Match, seed: int) -> None:
        """On the grid, before the first gate of the track or at its own places."""
        self.match, self.env = match, match.env
        gates = len(match.track.gates)
        self.people = [drone for drone, pilot in enumerate(match.team) if isinstance(pilot, HumanPilot)]
        start, flight = jax.random.split(jax.random.key(seed))
        state = start_races(self.env, start, BATCH, None if match.track.start else 0)
        rules = team_rules(match.team, match.collision_distance, match.track.gates_to_finish(match.laps), BATCH)
        self.race = RunningRace(self.env, match.team, rules, state, flight)
        self._crew = next(i for i, crew in enumerate(self.race.crews) if isinstance(crew.pilot, HumanPilot))
        self.order = Order(len(match.team), gates, match.laps)
        self.first_gate = int(state.next_gate[0, 0])
        dt = self.env.dynamics.control_dt
        self.most_steps = round(match.time_limit / dt)
        self.dt = dt
        self._seen = jax.tree.map(np.asarray, _look(self.env, state))

    @property
    def time(self) -> float:
        """Since the start [s]."""
        return self.race.steps * self.dt

    @property
    def over(self) -> bool:
        """Whether nobody flies any more."""
        return not self.race.flying or self.race.steps >= self.most_steps

    def flying(self, drone: int) -> bool:
        """Whether a drone is still in the race."""
        return self.order.status[drone] == "flying"

    def step(self, controls: Controls) -> bool:
        """Fly one control step; whether the order changed."""
        memories = list(self.race.memories)
        memories[self._crew] = controls
        self.race.memories = tuple(memories)
        time = self.time
        step, last = self.race.advance()
        self._seen = (last.position_w, last.velocity_w, last.euler)
        of_race = jax.tree.map(lambda values: values[0, :, 0], (step.crossing, step.further, step.collisions))
        return self.order.take(time, self.dt, Happened(*of_race), np.asarray(last.finished)[:, 0])

    def warm_up(self, controls: Controls) -> None:
        """Compile all that a race runs."""
        self.step(controls)
        self.retire(self.people[0])
        self.step(controls)

    def retire(self, drone: int) -> None:
        """Take a drone out of the race."""
        self.order.retire(drone)
        state = self.race.state
        self.race.state = state._replace(out=state.out.at[drone].set(True))

    def moment(self) -> dict[str, Any]:
        """Time [s] and, for every drone, position [m], velocity [m/s] and attitude (w, x, y, z)."""
        position, velocity, euler = (values[:, :, 0].T.astype(np.float64) for values in self._seen)
        rows = np.hstack([position, velocity, quaternions(euler)])
        return {"t": round(self.time, 4), "drones": np.round(rows, 4).tolist()}

    def log(self, names: tuple[str, ...]) -> RaceLog:
        """The race so far as a log like any other. At least one step has been flown."""
        return race_logs(self.race.flight(self.race.steps), self.match.info(names))[0]


@eqx.filter_jit
def _look(env: RaceEnv, state: RaceState) -> tuple[jax.Array, ...]:
    return state.drones.position_w, state.drones.velocity_w, env.dynamics.euler(state.drones)
