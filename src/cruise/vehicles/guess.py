"""A vehicle of which little is known: what a ruler, scales and the motor's data sheet say, and sane guesses."""

import math
from dataclasses import dataclass

from cruise.config import Airframe, Drag, Rates, Rotors, Tracking, Vehicle

# Ratios between those of the vehicles that were measured, the five-inch racer and the Crazyflie 2.0 (`named.py`).
LEVEL_INERTIA, YAW_INERTIA = 0.24, 0.43  # moment per mass and squared arm: 0.20 and 0.28, 0.37 and 0.49
TORQUE_RATIO = 0.3  # per radius of the propeller: 0.35 and 0.26
LEVEL_DRAG, VERTICAL_DRAG = 0.3, 0.4  # per mass [1/s]: 0.36 and 0.25, 0.56 and 0.28
ROTOR_LAG, RATE_LAG = 0.04, 0.05  # [s]: 0.033 and 0.072, 0.04 and 0.1
SPEED, STRENGTH = 12.0, 3.3  # the racer's speed reference at its thrust to weight


@dataclass(frozen=True)
class Measured:
    """What is easily known of a quadrotor."""

    mass: float = 0.75  # of all that flies, battery included [kg]
    arm: float = 0.125  # from the centre to a motor [m]
    propeller: float = 0.127  # diameter [m]
    thrust: float = 8.5  # of one motor at full throttle [N]


def guessed_vehicle(name: str, known: Measured) -> Vehicle:
    """A quadrotor in a square X with these numbers; the others are guesses, of the order of what was measured."""
    radius, side = known.propeller / 2, known.arm / math.sqrt(2)
    level, yaw = (share * known.mass * known.arm**2 for share in (LEVEL_INERTIA, YAW_INERTIA))
    gravity = Vehicle().gravity
    strength = 4 * known.thrust / (known.mass * gravity)
    speed = SPEED * math.sqrt(max(strength - 1, 0.1) / (STRENGTH - 1))
    return Vehicle(
        name=name,
        mass=known.mass,
        inertia=(_short(level), _short(level), _short(yaw)),
        gravity=gravity,
        control_dt=0.02,
        integrator="midpoint",
        substeps=5,
        collision_distance=_short(2 * (known.arm + radius)),
        source="mass, arm, propeller and thrust as given; the rest guessed by `cruise vehicles new`",
        control="ctbr",
        agility=_short(4 * known.thrust / known.mass),
        collision_aspect=0.5,
        flip_ends=False,
        tracking=Tracking(attitude_gain=10.0, speed=_short(speed), reach=_short(speed / 3)),
        airframe=Airframe(
            rotors=Rotors(
                offset=(_short(side), _short(side)),
                torque_ratio=_short(TORQUE_RATIO * radius),
                max_thrust=known.thrust,
                time_constant=ROTOR_LAG,
                radius=radius,
            ),
            rates=Rates(time_constant=RATE_LAG),
            drag=Drag(horizontal=_short(LEVEL_DRAG * known.mass), vertical=_short(VERTICAL_DRAG * known.mass)),
            longest_delay=0.02,
        ),
    )


# What the file says behind a number that is a guess, by its place in `Vehicle`.
GUESSES = {
    "inertia": f"guess: {LEVEL_INERTIA:g} (x, y) and {YAW_INERTIA:g} (z) x mass x arm^2; measure: bifilar pendulum",
    "collision_distance": "guess: two drones side by side, propellers touching",
    "collision_aspect": "guess; height per width of the ellipsoid in which two drones collide",
    "airframe.rotors.offset": "of every rotor from the centre, forward and sideways: a square X",
    "airframe.rotors.torque_ratio": f"guess: {TORQUE_RATIO:g} x propeller radius; measure: test stand",
    "airframe.rotors.time_constant": "guess; measure: step of the throttle on a test stand",
    "airframe.rates.time_constant": "guess; measure: step of the body rate in flight",
    "airframe.rates.highest": "roll, pitch, yaw that can be commanded: those of your flight controller",
    "airframe.drag.horizontal": f"guess: {LEVEL_DRAG:g} per kg; measure: tilt at steady speeds",
    "airframe.drag.vertical": f"guess: {VERTICAL_DRAG:g} per kg; measure: descents at steady speeds",
    "tracking.attitude_gain": "guess: about 0.9 over the lags of rotors and rate loop",
    "tracking.speed": "guess; a velocity reference at full deflection",
    "tracking.reach": "guess; a position reference at full deflection: so far from the drone",
}


def _short(value: float) -> float:
    """Three digits: a guess has no more."""
    return float(f"{value:.3g}")
