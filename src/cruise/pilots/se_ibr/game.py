"""The race as a game: rounds in which every drone answers the others' last plans with its best response.

Drone i maximises its own progress minus the others'. What the others lose by its plan is known to first order from the
multipliers of *their* collision constraints (Wang, Taubner and Schwager, 2020): it moves i into their way.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.pilots.se_ibr.admm import solve
from cruise.pilots.se_ibr.centre_line import CentreLine, frame_at, project
from cruise.pilots.se_ibr.options import Algorithm, Style
from cruise.pilots.se_ibr.programme import Multipliers, Programme, no_multipliers
from cruise.racing.field import opponent, opponents
from cruise.vector import dot, norm

GROUND_CLEARANCE = 0.3  # no plan goes lower [m]
LEAST_RISE = 1e-2  # of the corridor's upward axis where the centre line is upright
LEAST_HALF = 0.05  # of a corridor, whatever the margin [m]
MOST_LOST = 1.0  # progress that an opponent is taken to lose, per metre and step [-]
FIRST_SPEED = 0.5  # of the first guess, as a share of the top speed


class Traffic(NamedTuple):
    """Where all drones are when they plan."""

    position_w: Float[Array, "3 N *B"]  # [m]
    velocity_w: Float[Array, "3 N *B"]  # [m/s]
    airborne: Bool[Array, "N *B"]
    top_speed: Float[Array, "N *B"]  # [m/s]


class Plan(NamedTuple):
    """What all drones mean to do in the next K steps, as one planner sees it."""

    position_w: Float[Array, "3 K N *B"]  # [m]
    progress: Float[Array, "K N *B"]  # of these positions along the centre line [m]
    multipliers: Multipliers


def first_plan(line: CentreLine, algorithm: Algorithm, traffic: Traffic, progress: Float[Array, "N *B"]) -> Plan:
    """A guess of a step ago: from the drone on along the centre line, as far to the side of it as the drone is."""
    steps = jnp.arange(algorithm.horizon).reshape(-1, *(1,) * progress.ndim)
    ahead = progress + FIRST_SPEED * algorithm.dt * steps * traffic.top_speed
    aside = traffic.position_w - frame_at(line, progress).point_w
    position = frame_at(line, ahead).point_w + aside[:, None]
    return Plan(position, ahead, no_multipliers(progress.shape[0], algorithm.horizon, progress.shape[1:]))


def shifted(line: CentreLine, plan: Plan, steps: float) -> Plan:
    """The plan so many steps later, at most one, continued as it ends: the next planning starts from it.

    Laps are not counted on.
    """
    position = _later(plan.position_w, 1, steps)
    progress = _later(plan.progress, 0, steps)
    multipliers = Multipliers(*(_later(m, 1, steps) for m in plan.multipliers))
    multipliers = multipliers._replace(collision=jnp.maximum(multipliers.collision, 0.0))
    return Plan(position, progress - line.length * jnp.floor(progress[0] / line.length), multipliers)


def _later(values: Array, axis: int, steps: float) -> Array:
    """Linear between the values of a sequence along an axis, and beyond its end."""
    end = values.shape[axis]
    now, next_ = (jax.lax.slice_in_dim(values, first, end - 1 + first, axis=axis) for first in (0, 1))
    last = jax.lax.slice_in_dim(next_ - now, end - 2, end - 1, axis=axis)
    steps_on = jnp.concatenate([next_ - now, last], axis=axis)
    return values + steps * steps_on


def best_responses(line: CentreLine, algorithm: Algorithm, style: Style, traffic: Traffic, guess: Plan) -> Plan:
    """Rounds in which all drones answer at once, from a guess near the solution."""

    def answer(number: Array, plan: Plan) -> Plan:
        alpha = style.sensitivity * algorithm.decay**number
        programme, progress = linearised(line, algorithm, style, traffic, plan, alpha)
        position, multipliers = solve(programme, algorithm, (plan.position_w, plan.multipliers))
        return Plan(position, progress, multipliers)

    plan = jax.lax.fori_loop(0, algorithm.rounds, answer, guess)
    return plan._replace(progress=project(line, plan.position_w, plan.progress))


def linearised(
    line: CentreLine, algorithm: Algorithm, style: Style, traffic: Traffic, plan: Plan, alpha: Array | float
) -> tuple[Programme, Array]:
    """The best responses to a plan as convex programmes, and the progress of the plan's positions."""
    progress = project(line, plan.position_w, plan.progress)
    frame = frame_at(line, progress)
    towards, reach = _separating(plan.position_w, traffic.airborne, style.separation)
    reward = alpha * what_others_lose(plan.multipliers.collision, towards)
    half = jnp.maximum(frame.half - style.margin, LEAST_HALF)
    floor = (GROUND_CLEARANCE - frame.point_w[2]) / jnp.maximum(frame.up_w[2], LEAST_RISE)
    programme = Programme(
        position_w=traffic.position_w,
        velocity_w=traffic.velocity_w,
        reward=reward.at[:, -1].add(frame.tangent_w[:, -1]),
        centre_w=frame.point_w,
        left_w=frame.left_w,
        up_w=frame.up_w,
        low=jnp.stack([-half[0], jnp.minimum(jnp.maximum(-half[1], floor), half[1])]),
        high=half,
        towards_w=towards,
        reach=reach,
        speed=_speed_limits(algorithm, style, traffic),
        acceleration=jnp.broadcast_to(style.acceleration, traffic.top_speed.shape),
    )
    return programme, progress


def what_others_lose(multipliers: Float[Array, "M K N *B"], towards_w: Float[Array, "3 M K N *B"]) -> Array:
    """Gradient of the others' lost progress in every drone's own positions [3, K, N, *B].

    Opponent j's optimal progress changes by -mu_ji beta_ij . dp_i, with mu_ji the multiplier of its constraint against
    i and beta_ij the direction from i to j. Opponent k of i is j = i + k, so that i is opponent N - k of j. Where j
    cannot keep its distance the multiplier is the penalty's weight and says nothing of progress; hence `MOST_LOST`.
    """
    lost = jnp.zeros((towards_w.shape[0], *towards_w.shape[2:]))
    drones = towards_w.shape[3]
    for k in opponents(drones):
        theirs = jnp.minimum(opponent(multipliers[drones - k - 1], k, 1), MOST_LOST)
        lost = lost + theirs * towards_w[:, k - 1]
    return lost


def _separating(
    position_w: Float[Array, "3 K N *B"], airborne: Bool[Array, "N *B"], separation: Array | float
) -> tuple[Float[Array, "3 M K N *B"], Float[Array, "M K N *B"]]:
    """Half-spaces that keep every drone apart from each opponent's plan.

    Who is not in the air obstructs nobody: the direction to it is zero, which no position can break.
    """
    drones = position_w.shape[2]
    towards, reach = [jnp.zeros((3, 0, *position_w.shape[1:]))], [jnp.zeros((0, *position_w.shape[1:]))]
    for k in opponents(drones):
        theirs = opponent(position_w, k, 2)
        offset = theirs - position_w
        both = airborne & opponent(airborne, k, 0)
        direction = jnp.where(both, offset / jnp.maximum(norm(offset), 1e-6), 0.0)
        towards.append(direction[:, None])
        reach.append((dot(direction, theirs) - separation)[None])
    return jnp.concatenate(towards, axis=1), jnp.concatenate(reach)


def _speed_limits(algorithm: Algorithm, style: Style, traffic: Traffic) -> Float[Array, "K N *B"]:
    """The top speed; for who is faster what it can brake to, so that there is always a plan."""
    steps = jnp.arange(1, algorithm.horizon + 1).reshape(-1, *(1,) * traffic.airborne.ndim)
    braked = norm(traffic.velocity_w) - style.acceleration * algorithm.dt * steps
    return jnp.maximum(traffic.top_speed, braked)
