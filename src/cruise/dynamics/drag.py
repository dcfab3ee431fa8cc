"""Drag on a quadrotor that moves through the air."""

from cruise.dynamics.algebra import JAX, Algebra
from cruise.dynamics.parameters import Physics, Scalar
from cruise.dynamics.quaternion import Three, Vector


def drag_force_w(
    physics: Physics, velocity_w: Vector, air_w: Vector | None, axis_w: Vector, algebra: Algebra = JAX
) -> Three | None:
    """F = -d_h u - (d_v - d_h) (b . u) b - k |u| u [N] at the airspeed u = v - v_air; None where every term is off.

    Linear in the airspeed and different along the thrust axis b than across it: the drag that rotors induce (Faessler,
    Franchi and Scaramuzza, Differential Flatness of Quadrotor Dynamics Subject to Rotor Drag, RA-L 2018, alike in both
    directions of the rotors' plane). Quadratic: of the body, F = rho C_D A |u| u / 2.
    """
    across, along, quadratic = physics.horizontal_drag, physics.vertical_drag, physics.quadratic_drag
    if _off(across) and _off(along) and _off(quadratic):
        return None
    x, y, z = velocity_w if air_w is None else (v - a for v, a in zip(velocity_w, air_w, strict=True))
    bx, by, bz = axis_w
    if not _off(quadratic):
        by_speed = quadratic * algebra.sqrt(x * x + y * y + z * z)
        across, along = across + by_speed, along + by_speed
    extra = (along - across) * (x * bx + y * by + z * bz)
    return -across * x - extra * bx, -across * y - extra * by, -across * z - extra * bz


def _off(term: Scalar) -> bool:
    return isinstance(term, float) and term == 0
