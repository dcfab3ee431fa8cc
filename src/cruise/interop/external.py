"""Another simulator in the place of our equations of motion: races, pilots, rules and logs stay what they are."""

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from cruise.config import Vehicle
from cruise.dynamics import Dynamics, FreeBody
from cruise.dynamics.quadrotor import Memory, make_quadrotor, rates_asked
from cruise.dynamics.references import with_control
from cruise.dynamics.rigid_body import Wrench
from cruise.dynamics.rotors import rotor_thrusts, wrench_of
from cruise.dynamics.types import DroneState
from cruise.interop.flight_controller import rotors_of

# (body, thrusts of the rotors [4, K] N, thrust per mass [K] m/s^2, body rates [3, K] rad/s) -> body, thrusts: what they
# are one control step later. Bodies are `FreeBody` with components first, K drones last.
Advance = Callable[[FreeBody, Array, Array, Array], tuple[FreeBody, Array]]


@runtime_checkable
class Host(Protocol):
    """A simulator in NumPy, which JAX calls back: one control step from a state that it is given."""

    def advance(self, body: FreeBody, thrusts: Any, thrust: Any, rates_b: Any) -> tuple[FreeBody, Any]:
        """As `Advance`, on NumPy arrays."""
        ...


def make_external(vehicle: Vehicle, advance: Advance) -> Dynamics:
    """The vehicle as `advance` moves it; start, observation and what an action means are ours.

    The ground is the simulator's, if it has one: touching it is a matter of the rules. A vehicle's delay, battery and
    downwash are not carried over, nor is what `perturb` makes of its body. An attitude loop looks once a control step.

    Raises:
        CruiseError: the vehicle has no rotors.
    """
    rotors_of(vehicle)
    own = make_quadrotor(vehicle)._replace(step=partial(_step, vehicle, advance), induced_air=None)
    return with_control(vehicle, own)


def called_back(host: Host) -> Advance:
    """A NumPy simulator as JAX can compile it."""

    def advance(body: FreeBody, thrusts: Array, thrust: Array, rates_b: Array) -> tuple[FreeBody, Array]:
        def call(*arguments: Any) -> tuple[FreeBody, Any]:
            state = jax.tree.map(lambda x: np.asarray(x, np.float64), arguments)
            return jax.tree.map(lambda x: np.asarray(x, np.float32), host.advance(*state))

        shape = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, jnp.float32), (body, thrusts))
        moved: tuple[FreeBody, Array] = jax.pure_callback(call, shape, body, thrusts, thrust, rates_b)
        return moved

    return advance


def _step(
    vehicle: Vehicle,
    advance: Advance,
    state: DroneState,
    action: Float[Array, "4 *B"],
    agility: Array | float,
    air_w: Array | None = None,
) -> DroneState:
    """One control step, all drones of all races side by side."""
    del air_w
    rotors, memory = rotors_of(vehicle), state.memory
    assert isinstance(state.body, FreeBody)
    action = jnp.clip(action, -1.0, 1.0)
    asked = rates_asked(vehicle, action, agility, state.body.attitude)
    thrusts = rotor_thrusts(rotors, Wrench(memory.wrench[0], memory.wrench[1:]))
    flat = partial(jax.tree.map, lambda x: x.reshape(x.shape[0], -1))
    thrust = jnp.broadcast_to(asked.thrust, action.shape[1:]).reshape(-1)
    body, after = advance(flat(state.body), flat(thrusts), thrust, flat(jnp.stack(asked.rates_b)))
    body, after = jax.tree.map(lambda x: x.reshape(x.shape[0], *action.shape[1:]), (body, after))
    wrench = wrench_of(rotors, after)
    commands = jnp.concatenate([action[None], memory.commands[:-1]])
    together = jnp.concatenate([wrench.collective_thrust[None], wrench.body_torque_b])
    return DroneState(body, Memory(together, commands, memory.charge), state.parameters)
