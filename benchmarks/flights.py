"""Races of pilots: flown to be measured, as `cruise evaluate` does, or planned for by SE-IBR."""

import math
from collections.abc import Sequence

import jax
from jaxtyping import Array

from benchmarks.environment import TRACK
from benchmarks.roofline import Cost, count
from cruise.env.race_env import RaceEnv, make_race_env
from cruise.env.types import RaceState, Rules
from cruise.errors import CruiseError
from cruise.evaluation.matches import evaluate_match, make_match, run_races
from cruise.pilots.base import Pilot, crews
from cruise.pilots.named import NAMED
from cruise.pilots.python_pilot import separate_python_pilots
from cruise.presets import TRACKS, VEHICLES
from cruise.rollout import CHUNK, act_together, first_memories, fly, team_rules
from cruise.storage.policy_file import shipped_name

RACES = 100
PLANNED_DRONES, PLANNED_SECONDS = 4, 50.0
VEHICLE = VEHICLES["paper"]


def pilot_of(drones: int) -> str:
    """The policy shipped for the ring, or where there is none a pilot that needs no training."""
    try:
        return shipped_name(TRACK, drones)
    except CruiseError:
        return "chaser"


def step_cost(env: RaceEnv, team: Sequence[Pilot], rules: Rules, races: int) -> Cost:
    """Of one control step of so many races: everyone's pilot, then the environment."""
    groups, _ = separate_python_pilots(env, crews(team))

    def begin(key: Array) -> tuple[RaceState, tuple]:
        state = env.reset(key, (races,))
        return state, first_memories(env, groups, state)

    def step(state: RaceState, memories: tuple, key: Array) -> tuple:
        memories, action = act_together(env, groups, memories, state, key)
        return memories, env.step(state, action, rules)

    key = jax.random.key(0)
    begun = jax.eval_shape(begin, key)
    cost, passing = count(jax.jit(step).trace(*begun, key).jaxpr), jax.tree.leaves(begun)
    return Cost(cost.flop, cost.bytes + 2 * sum(leaf.size * leaf.dtype.itemsize for leaf in passing))


class EvaluationCase:
    """`cruise evaluate` without its start: races of three laps, flown and measured. Its unit is the race."""

    def __init__(self, drones: int, races: int = RACES) -> None:
        """Put the match together and fly it once, which compiles."""
        self.work = float(races)
        self.races = races
        self.match = match = make_match(TRACKS[TRACK], drones, pilot_of(drones))
        rules = team_rules(match.team, 0.0, 0, (races,))
        longest = max(len(log.time) - 1 for log in run_races(match, races, seed=0))
        self.cost = step_cost(match.env, match.team, rules, races).times(_flown(longest) / races)

    def __call__(self) -> None:
        """Evaluate once."""
        evaluate_match(self.match, self.races, seed=0)


class PlannerCase:
    """Races flown by the planner, without end and over no finish line. Its unit is one plan for one drone."""

    def __init__(self, races: int = RACES, drones: int = PLANNED_DRONES, seconds: float = PLANNED_SECONDS) -> None:
        """Fly once, which compiles."""
        self.races, self.steps = races, round(seconds / VEHICLE.control_dt)
        self.work = float(races * drones * self.steps)
        self.env = make_race_env(TRACKS[TRACK], drones, VEHICLE)
        self.team = [NAMED["se-ibr"]] * drones
        self.rules = team_rules(self.team, 0.0, 0, (races,))
        self.cost = step_cost(self.env, self.team, self.rules, races).times(_flown(self.steps) / self.work)
        self()

    def __call__(self) -> None:
        """Fly from fresh starts."""
        fly(self.env, self.team, self.rules, jax.random.key(0), self.steps, (self.races,))


def _flown(steps: int) -> int:
    """How many steps are computed where so many are needed."""
    return CHUNK * math.ceil(steps / CHUNK)
