"""`python -m benchmarks.vehicles`: what the physics of each vehicle costs, alone and in the environment."""

import json
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Array

from benchmarks.environment import EnvironmentCase
from benchmarks.machine import Case, describe_machine, interleave, rates
from cruise.config import Vehicle
from cruise.dynamics import DroneState, Parameters, make_dynamics
from cruise.dynamics.parameters import AS_BUILT
from cruise.presets import VEHICLES

STEPS, DRONES, RACES = 64, 4, 512
RACER = VEHICLES["racer"]


class PhysicsCase:
    """Drones under random actions, nothing else. Its unit is the control step of one drone."""

    def __init__(self, vehicle: Vehicle, parameters: Parameters = AS_BUILT) -> None:
        """Compile it."""
        self.work = float(STEPS * DRONES * RACES)
        dynamics = make_dynamics(vehicle)
        shape = (dynamics.action_size, DRONES, RACES + STEPS)
        self._actions = jnp.asarray(np.random.default_rng(0).uniform(-1.0, 1.0, shape), jnp.float32)
        high = jnp.zeros((3, DRONES, RACES)).at[2].set(100.0)
        self._start = dynamics.init(high, jnp.zeros((DRONES, RACES)), parameters)

        def fly(state: DroneState, actions: Array) -> DroneState:
            def step(state: DroneState, t: Array) -> tuple[DroneState, None]:
                action = jax.lax.dynamic_slice_in_dim(actions, t, RACES, axis=2)
                return dynamics.step(state, action, vehicle.agility), None

            return jax.lax.scan(step, state, jnp.arange(STEPS))[0]

        self._fly = jax.jit(fly).lower(self._start, self._actions).compile()

    def __call__(self) -> None:
        """Fly `STEPS` steps from the start."""
        jax.block_until_ready(self._fly(self._start, self._actions))


def randomised() -> Parameters:
    """Every parameter of every drone its own."""

    def spread(value: float) -> Array:
        return value * jnp.linspace(0.9, 1.1, DRONES * RACES).reshape(DRONES, RACES)

    assert RACER.airframe is not None
    return Parameters(
        mass=spread(RACER.mass),
        inertia=jnp.stack([spread(moment) for moment in RACER.inertia]),
        thrust_gain=spread(1.0),
        horizontal_drag=spread(0.27),
        vertical_drag=spread(0.42),
        rotor_lag=spread(0.033),
        rate_lag=spread(0.04),
        delay=spread(0.01),
        wind_w=jnp.stack([spread(1.0)] * 3),
    )


def cases() -> dict[str, Case]:
    """What is timed, in turn."""
    return {
        "paper, 10 Hz": PhysicsCase(VEHICLES["paper"]),
        "racer, 50 Hz over 250 Hz": PhysicsCase(RACER),
        "racer, 50 Hz over 500 Hz": PhysicsCase(replace(RACER, substeps=10)),
        "racer, everything randomised": PhysicsCase(RACER, randomised()),
        "racer, by velocity": PhysicsCase(replace(RACER, control="velocity")),
        "environment, paper, extended": EnvironmentCase(RACES, DRONES, "extended"),
        "environment, racer, body": EnvironmentCase(RACES, DRONES, "body", "racer"),
    }


@dataclass(frozen=True)
class Vehicles:
    """Control steps of one drone per second, median over rounds in which every case runs once."""

    rounds: int = 30
    seconds: float = 60.0
    json: bool = False

    def run(self) -> None:
        """Measure and print."""
        timed = cases()
        measured = rates(timed, interleave(timed, self.rounds, self.seconds))
        if self.json:
            print(json.dumps({"machine": describe_machine(), "drone_steps_per_s": measured}, indent=2))
            return
        for name, rate in measured.items():
            print(f"{name:32} {rate / 1e6:8.2f} M drone-steps/s")


if __name__ == "__main__":
    tyro.cli(Vehicles, prog="python -m benchmarks.vehicles").run()
