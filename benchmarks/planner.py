"""The SE-IBR planner: whole races planned for all drones, ten times a second."""

import statistics

import jax

from benchmarks.environment import TRACK
from benchmarks.headline import Effort, Say
from benchmarks.machine import interleave
from cruise.env.race_env import make_race_env
from cruise.pilots.named import NAMED
from cruise.presets import TRACKS, VEHICLES
from cruise.rollout import fly, team_rules

RACES, DRONES, SECONDS = 100, 4, 50.0
VEHICLE = VEHICLES["paper"]


class PlannerCase:
    """Races flown by the planner, without end and over no finish line. Its unit is one plan for one drone."""

    def __init__(self, races: int = RACES, drones: int = DRONES, seconds: float = SECONDS) -> None:
        """Fly once, which compiles."""
        self.steps = round(seconds / VEHICLE.control_dt)
        self.batch = (races,)
        self.work = float(races * drones * self.steps)
        self.env = make_race_env(TRACKS[TRACK], drones, VEHICLE)
        self.team = [NAMED["se-ibr"]] * drones
        self.rules = team_rules(self.team, 0.0, 0, self.batch)
        self()

    def __call__(self) -> None:
        """Fly from fresh starts."""
        fly(self.env, self.team, self.rules, jax.random.key(0), self.steps, self.batch)


def planner_seconds(effort: Effort, say: Say) -> float:
    """Median time of 100 races of four drones over 50 s, planned every 0.1 s in three rounds, compiling apart [s]."""
    say("compiling the planner")
    case = PlannerCase()
    say("timing the planner")
    return statistics.median(interleave({"planner": case}, 3, effort.seconds)["planner"])
