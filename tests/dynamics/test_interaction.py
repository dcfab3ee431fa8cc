"""What drag, downwash and battery do to a quadrotor in flight."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from cruise.config import Battery, Drag
from cruise.dynamics import Dynamics, Parameters, Reference
from cruise.vehicles import BATTERIES
from tests.dynamics.quadrotors import RACER, action_for, dynamics_of, fly, state_of, with_airframe

WEIGHT = RACER.mass * RACER.gravity
BLOWN = with_airframe(RACER, downwash=True)


def test_a_drone_below_another_is_pushed_down() -> None:
    """Two drones hovering one above the other: without downwash both stay, with it the lower one sinks."""
    places = jnp.array([[0.0, 0.0], [0.0, 0.0], [6.0, 4.5]])
    action = jnp.asarray(np.repeat(action_for(RACER, WEIGHT)[:, None], 2, axis=1), jnp.float32)

    def fallen(dynamics: Dynamics) -> np.ndarray:
        def advance(state, _):
            air = dynamics.induced_air(state, jnp.ones(2, bool)) if dynamics.induced_air else None
            return dynamics.step(state, action, RACER.agility, air), None

        start = dynamics.init(places, jnp.zeros(2))
        end, _ = jax.jit(lambda state: jax.lax.scan(advance, state, length=50))(start)
        return np.asarray(places - end.position_w)

    assert np.abs(fallen(dynamics_of(RACER))).max() < 1e-3
    blown = fallen(dynamics_of(BLOWN))
    assert np.abs(blown[:, 0]).max() < 1e-3
    assert blown[2, 1] > 0.5
    assert np.abs(blown[:2, 1]).max() < 1e-3


def test_a_battery_that_is_not_there_is_no_part_of_the_state() -> None:
    states = [
        dynamics_of(v).init(jnp.zeros((3, 2)), jnp.zeros(2)) for v in (RACER, with_airframe(RACER, battery=Battery()))
    ]
    without, with_one = (len(jax.tree.leaves(state)) for state in states)
    assert with_one == without + 1


def test_a_sagging_battery_lets_a_drone_sink_ever_faster() -> None:
    """Held hover thrust: charge falls steadily, thrust falls short of the weight by a growing share."""
    small = replace(BATTERIES["racer"], capacity=200.0)
    vehicle = with_airframe(RACER, battery=small, drag=Drag())
    states = fly(vehicle, state_of(vehicle), np.broadcast_to(action_for(vehicle, WEIGHT), (300, 4)))
    charge, sinking = np.asarray(states.memory.charge), np.asarray(states.body.velocity_w)[:, 2]
    assert (np.diff(charge) < 0).all()
    assert 0.2 < charge[-1] < 0.9
    lost = -np.diff(sinking) / RACER.control_dt / RACER.gravity  # share of the weight
    assert (np.diff(lost[5:]) > 0).all()
    assert 0.01 < lost[5] < lost[-1] < 0.5


def test_a_weaker_rotor_needs_a_larger_command() -> None:
    """Thrust gain 0.8: hovering takes 1.25 times the thrust that the controller believes to give."""
    start = state_of(RACER)._replace(parameters=Parameters(thrust_gain=jnp.asarray(0.8)))
    states = fly(RACER, start, np.broadcast_to(action_for(RACER, WEIGHT / 0.8), (200, 4)))
    sinking = np.diff(np.asarray(states.body.velocity_w)[:, 2])
    assert abs(sinking[-1]) < 1e-5 + 0.01 * abs(sinking[0])


def test_position_is_held_in_a_steady_wind() -> None:
    """The position loop leans into the wind and keeps near."""
    dynamics = dynamics_of(RACER)
    start = dynamics.init(jnp.array([0.0, 0.0, 5.0]), jnp.zeros(()), Parameters(wind_w=jnp.array([4.0, 0.0, 0.0])))
    there = Reference(position_w=start.position_w)

    def advance(state, _):
        return dynamics.step(state, dynamics.track(state, there, RACER.agility), RACER.agility), None

    end, _ = jax.jit(lambda state: jax.lax.scan(advance, state, length=250))(start)
    assert np.abs(np.asarray(end.position_w - start.position_w)).max() < 0.5
    assert float(dynamics.euler(end)[1]) < -0.05
