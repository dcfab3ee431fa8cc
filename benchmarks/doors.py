"""`python -m benchmarks.doors`: every door to the races side by side, and Crazyflow through Gymnasium.

Steps of one drone per second of processor time, by the median of rounds in which every case runs once, in turn.
"""

import json
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

import cruise
from benchmarks.adapters import DRONES, INTERFACES, OPPONENTS, RACES, STEPS, InterfaceCase
from benchmarks.environment import TRACK
from benchmarks.machine import Case, describe_machine, versions
from benchmarks.peers.apart import Apart

LENGTH = 16  # steps of a rollout
FASTEST = "cruise.make, races last"


class FunctionalCase:
    """A rollout in one compiled program, as a learning loop in JAX collects it: what was seen and paid is kept."""

    def __init__(self, layout: str, races: int = RACES, drones: int = DRONES, length: int = LENGTH) -> None:
        """Compile it, random actions drawn beforehand."""
        self.work = float(races * drones * length)
        env = cruise.make(TRACK, drones, layout=layout)
        key, first = jax.random.key(0), jax.random.split(jax.random.key(1), races)
        table = jax.random.uniform(key, (length, *env.action_space().shape, drones, races), minval=-1.0)
        reset, step, keys, actions = env.reset, env.step, key, table
        if layout == "agents":
            reset, step, keys = jax.vmap(env.reset), jax.vmap(env.step), first
            actions = {agent: jnp.moveaxis(table[:, :, i], 1, 2) for i, agent in enumerate(env.agents)}

        def kept(state: Any, action: Any) -> tuple[Any, Any]:
            observation, state, reward, *_ = step(keys, state, action)
            return state, (observation, reward)

        self._state, self._actions = jax.jit(reset)(first)[1], actions
        fly = jax.jit(lambda state, actions: jax.lax.scan(kept, state, actions))
        self._fly = fly.lower(self._state, actions).compile()

    def __call__(self) -> None:
        """Fly on."""
        self._state, _ = jax.block_until_ready(self._fly(self._state, self._actions))


class StableBaselinesCase:
    """Stable-Baselines3's vector environment under random actions, one learner among opponents."""

    def __init__(self) -> None:
        """Compile it. Raises ImportError where Stable-Baselines3 is not installed."""
        import stable_baselines3  # noqa: F401, PLC0415

        from cruise.adapters.sb3 import StableBaselinesEnv  # noqa: PLC0415

        self.work = float(RACES * DRONES * STEPS)
        self._env = StableBaselinesEnv(RACES, track=TRACK, drones=DRONES, opponents=OPPONENTS)
        self._env.reset()
        self._actions = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, RACES, 3)).astype(np.float32)
        self._env.step(self._actions[0])

    def __call__(self) -> None:
        """Step all races."""
        for actions in self._actions:
            self._env.step(actions)


def _cases(crazyflow: str) -> Mapping[str, Callable[[], Case]]:
    return {
        FASTEST: lambda: FunctionalCase("races-last"),
        "cruise.make, agents, under vmap": lambda: FunctionalCase("agents"),
        **{interface: lambda interface=interface: InterfaceCase(interface) for interface in INTERFACES},
        "Stable-Baselines3, vector": StableBaselinesCase,
        "Crazyflow, Gymnasium, vector": lambda: Apart(crazyflow, "benchmarks.peers.simulators:CrazyflowRoom"),
    }


@dataclass(frozen=True)
class Doors:
    """How many steps each door makes, on this machine, in turn."""

    rounds: int = 5
    """How often each is timed, after a first time that does not count."""
    crazyflow: str = ".venv-crazyflow/bin/python"
    """Python that has Crazyflow; `make peers` makes this one."""
    json: bool = False
    """Print one JSON object instead of a table."""

    def run(self) -> None:
        """Time whatever is installed; name what is not."""
        cases: dict[str, Case] = {}
        for name, build in _cases(self.crazyflow).items():
            try:
                cases[name] = build()
            except ImportError as missing:
                print(f"left out: {name} ({missing.name} is not installed)")
        taken = [{name: processor_seconds(case) for name, case in cases.items()} for _ in range(self.rounds + 1)][1:]
        rates = {name: case.work / statistics.median(each[name] for each in taken) for name, case in cases.items()}
        if self.json:
            print(json.dumps({"machine": describe_machine(), "versions": versions(), "rates": rates}, indent=2))
            return
        for name, rate in rates.items():
            print(
                f"{name:34} {rate:12,.0f} drone-steps per processor second, {rate / rates[FASTEST]:6.1%} of the first"
            )


def processor_seconds(case: Case) -> float:
    """Of a call, on all cores together."""
    began = time.process_time()
    case()
    return getattr(case, "used", None) or time.process_time() - began


if __name__ == "__main__":
    tyro.cli(Doors).run()
