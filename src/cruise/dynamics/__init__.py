"""How a quadrotor flies: equations of motion, integrators and controllers."""

from cruise.config import Vehicle
from cruise.dynamics.cascade import make_cascade
from cruise.dynamics.types import DroneState, Dynamics, RigidBody

__all__ = ["DroneState", "Dynamics", "RigidBody", "make_dynamics"]


def make_dynamics(vehicle: Vehicle) -> Dynamics:
    """Pure functions of a vehicle; integrator and controller are chosen here, once."""
    return make_cascade(vehicle)
