"""Physical parameters that may differ from race to race inside the compiled step."""

from dataclasses import replace
from typing import Any, NamedTuple

from jaxtyping import Array, Float

from cruise.config import Vehicle

Scalar = Float[Array, "*B"] | float
Triple = Float[Array, "3 *B"] | tuple[float, float, float]


class Parameters(NamedTuple):
    """What the body really is, whatever its flight controller believes. None: as the vehicle says, at no cost.

    A state carries these along: arrays over drones and races, so that a race that begins anew has new ones.
    """

    mass: Scalar | None = None  # [kg]
    inertia: Triple | None = None  # principal moments [kg m^2]
    thrust_gain: Scalar | None = None  # thrust and torque of the rotors, as a share of what they should give
    horizontal_drag: Scalar | None = None  # [kg/s]
    vertical_drag: Scalar | None = None  # [kg/s]
    quadratic_drag: Scalar | None = None  # [kg/m]
    rotor_lag: Scalar | None = None  # time constant of the thrust [s]
    rate_lag: Scalar | None = None  # time constant of the body-rate loop [s]
    clip_share: Scalar | None = None  # of a demand's cut to the rotors' limits that is made rotor by rotor
    delay: Scalar | None = None  # from an action to its effect [s]
    wind_w: Triple | None = None  # velocity of the air [m/s]
    integral_gain: Scalar | None = None  # of the rate loop [1/s]
    min_thrust: Scalar | None = None  # that a rotor is told, at least [N]
    thrust_curve: Scalar | None = None  # how far a rotor's thrust goes with the square of its command


AS_BUILT = Parameters()


class Physics(NamedTuple):
    """The same, all of them known: plain numbers, which the compiler folds into its constants, or arrays."""

    mass: Scalar
    inertia: Triple
    thrust_gain: Scalar
    horizontal_drag: Scalar
    vertical_drag: Scalar
    quadratic_drag: Scalar
    rotor_lag: Scalar
    rate_lag: Scalar
    clip_share: Scalar | None  # None: by priority alone
    delay: Scalar
    wind_w: Triple | None  # None: the air stands still
    integral_gain: Scalar
    min_thrust: Scalar
    thrust_curve: Scalar


def physics_of(vehicle: Vehicle, parameters: Parameters = AS_BUILT) -> Physics:
    """The vehicle's own numbers, and `parameters` in place of those that they give."""
    airframe = vehicle.airframe
    assert airframe is not None
    built = Physics(
        mass=vehicle.mass,
        inertia=vehicle.inertia,
        thrust_gain=1.0,
        horizontal_drag=airframe.drag.horizontal,
        vertical_drag=airframe.drag.vertical,
        quadratic_drag=airframe.drag.quadratic,
        rotor_lag=airframe.rotors.time_constant,
        rate_lag=airframe.rates.time_constant,
        clip_share=None,
        delay=airframe.delay,
        wind_w=None,
        integral_gain=airframe.rates.integral_gain,
        min_thrust=airframe.rotors.min_thrust,
        thrust_curve=airframe.rotors.thrust_curve,
    )
    changed: dict[str, Any] = {name: value for name, value in parameters._asdict().items() if value is not None}
    return built._replace(**changed)


def remembering(vehicle: Vehicle, extra_delay: float) -> Vehicle:
    """The vehicle, remembering commands for so much longer than its own delay [s]."""
    airframe = vehicle.airframe
    assert airframe is not None
    longest = max(airframe.longest_delay, airframe.delay + extra_delay)
    return replace(vehicle, airframe=replace(airframe, longest_delay=longest))
