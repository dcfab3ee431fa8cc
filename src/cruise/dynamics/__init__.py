"""How a quadrotor flies: equations of motion, integrators and controllers."""

from cruise.config import Vehicle
from cruise.dynamics.cascade import make_cascade
from cruise.dynamics.parameters import Parameters
from cruise.dynamics.quadrotor import make_quadrotor
from cruise.dynamics.references import with_control
from cruise.dynamics.types import DroneState, Dynamics, FreeBody, Reference, RigidBody
from cruise.vehicles.checks import check_vehicle

__all__ = ["DroneState", "Dynamics", "FreeBody", "Parameters", "Reference", "RigidBody", "make_dynamics"]


def make_dynamics(vehicle: Vehicle) -> Dynamics:
    """Pure functions of a vehicle; integrator, controller and the meaning of an action are chosen here, once.

    Raises:
        CruiseError: a number of the vehicle makes no sense, or it cannot be flown by what its actions are said to mean.
    """
    check_vehicle(vehicle)
    dynamics = make_cascade(vehicle) if vehicle.airframe is None else make_quadrotor(vehicle)
    return with_control(vehicle, dynamics)
