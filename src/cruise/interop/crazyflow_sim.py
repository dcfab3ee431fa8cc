"""Crazyflow: its first-principles dynamics with rotors whose speeds lag, in JAX like ours."""

import contextlib
import io
import warnings
from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array

from cruise.config import Vehicle
from cruise.dynamics import FreeBody
from cruise.dynamics.rotors import PITCH, ROLL, YAW, levers
from cruise.interop.external import Advance
from cruise.interop.flight_controller import airframe_of, rotor_commands, rotors_of

with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):  # it misses GPU libraries
    from crazyflow.control import Control
    from crazyflow.dynamics import Dynamics as Model
    from crazyflow.sim import Sim
    from crazyflow.sim import functional as crazyflow
    from crazyflow.sim.sim import clip_rotor_vel_cmd

RATE = 500  # of the flight controller and of the physics: Crazyflow's own [Hz]
FASTEST = 24_000.0  # of the rotors; thrust is fitted to it, so that any will do [rpm]


def make_advance(vehicle: Vehicle) -> Advance:
    """One control step of any number of drones, each in a world of its own.

    Raises:
        CruiseError: the vehicle has no rotors.
    """
    rotors = rotors_of(vehicle)
    factor = rotors.max_thrust / FASTEST**2
    substeps = round(vehicle.control_dt * RATE)

    @cache
    def simulator(worlds: int) -> Sim:
        with jax.ensure_compile_time_eval(), _quiet():
            return _simulator(vehicle, worlds, factor)

    def advance(body: FreeBody, thrusts: Array, thrust: Array, rates_b: Array) -> tuple[FreeBody, Array]:
        sim = simulator(thrusts.shape[1])
        start = _placed(sim.data, body, jnp.sqrt(jnp.maximum(thrusts, 0.0) / factor))

        def substep(data: Any, _: None) -> tuple[Any, None]:
            measured = data.states.ang_vel[:, 0].T
            wanted = jnp.stack(rotor_commands(vehicle, thrust, rates_b, measured))
            data = crazyflow.rotor_vel_control(data, jnp.sqrt(wanted / factor).T[:, None])
            return sim._step(data, n_steps=1), None

        end = jax.lax.scan(substep, start, length=substeps)[0].states
        x, v, q, w, speeds = (part[:, 0].T for part in (end.pos, end.vel, end.quat, end.ang_vel, end.rotor_vel))
        return FreeBody(x, v, jnp.roll(q, 1, axis=0), w), factor * speeds**2

    return advance


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without a warning of MuJoCo about names of bodies, which it also writes into a file where the user is."""
    told = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            yield
    finally:
        mujoco.set_mju_user_warning(told)


def _placed(data: Any, body: FreeBody, speeds: Array) -> Any:
    """Crazyflow's data with every drone where it is. Its quaternions are (x, y, z, w)."""
    q = jnp.roll(body.attitude, -1, axis=0)
    parts = (body.position_w, body.velocity_w, q, body.angular_velocity_b, speeds)
    x, v, q, w, speeds = (part.T[:, None] for part in parts)
    return data.replace(states=data.states.replace(pos=x, vel=v, quat=q, ang_vel=w, rotor_vel=speeds))


def _simulator(vehicle: Vehicle, worlds: int, factor: float) -> Sim:
    """Crazyflow with the vehicle's numbers in the place of a Crazyflie's."""
    sim = Sim(n_worlds=worlds, dynamics=Model.first_principles, control=Control.rotor_vel, freq=RATE)
    params, rotors, airframe = sim.data.params, rotors_of(vehicle), airframe_of(vehicle)
    inertia = jnp.diag(jnp.array(vehicle.inertia))
    drag = -jnp.diag(jnp.array([airframe.drag.horizontal, airframe.drag.horizontal, airframe.drag.vertical]))
    sideways, forward, _ = levers(rotors)
    mixing = jnp.array([[sideways * s for s in ROLL], [forward * s for s in PITCH], list(YAW)])
    speed_up = 1 / max(rotors.time_constant, 1e-3)
    changed = {
        "mass": vehicle.mass,
        "J": inertia,
        "J_inv": jnp.linalg.inv(inertia),
        "gravity_vec": jnp.array([0.0, 0.0, -vehicle.gravity]),
        "L": 1.0,  # levers are in the mixing matrix
        "prop_inertia": 0.0,  # the vehicles have none
        "rpm2thrust": jnp.array([0.0, 0.0, factor]),
        "rpm2torque": jnp.array([0.0, 0.0, factor * rotors.torque_ratio]),
        "mixing_matrix": mixing,
        "drag_matrix": drag,
        "rotor_dyn_coef": jnp.array([speed_up, 0.0, speed_up, 0.0]),
    }
    shaped = {name: jnp.broadcast_to(value, getattr(params, name).shape) for name, value in changed.items()}
    sim.data = sim.data.replace(params=params.replace(**shaped))
    lowest = FASTEST * (rotors.min_thrust / rotors.max_thrust) ** 0.5
    limits = partial(clip_rotor_vel_cmd, lower=lowest, upper=FASTEST, dynamics=Model.first_principles)
    sim.step_pipeline["clip_rotor_vel_cmd"] = limits
    sim.build_step_fn()
    return sim
