"""A track as arrays. Components lead and drones or races trail, so every function broadcasts over them."""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from cruise.config import Gate, Track
from cruise.racing.motion import motion_row
from cruise.racing.solids import solid_columns
from cruise.vector import is_plain, sin_cos

UNROLLED = 16  # gates or solids up to which a loop over them is written out: more are scanned, or gathered


class Motions(NamedTuple):
    """How each gate of a course moves, see `cruise.config.Motion`; one that stands still has amplitudes of 0."""

    sway_w: Float[Array, "3 G"]  # [m]
    swing: Float[Array, "G"] | None  # [rad]; None: no gate swings
    period: Float[Array, "G"]  # [s]
    turns: Float[Array, "G"]  # the phase, of a whole turn


class Course(NamedTuple):
    """Gates, solids and limits of a track [m, rad, world frame].

    Where races differ in their gates, places and headings have batch axes. What no gate of the track has is None and
    costs nothing.
    """

    position_w: Float[Array, "3 G *B"]
    normal_w: Float[Array, "2 G *B"]  # (cos yaw, sin yaw): the heading of flight
    half_size: Float[Array, "2 G"]  # half width and half height of the openings
    frame_width: Float[Array, ""]
    bounds_low: Float[Array, "3"]
    bounds_high: Float[Array, "3"]
    leave_distance: Float[Array, ""]
    tilt: Float[Array, "4 G *B"] | None = None  # (cos pitch, sin pitch, cos roll, sin roll); None: all stand upright
    is_round: Bool[Array, "1 G"] | None = None  # None: all are rectangles
    half_depth: Float[Array, ""] | None = None  # of frames along the flight; None: they have none
    solids: dict[str, Float[Array, "C S *B"]] | None = None  # by kind, see `cruise.racing.solids`; None: gates alone
    motions: Motions | None = None  # about where the gates are at rest; None: all stand still
    later: "Course | None" = None  # at the end of the step that is judged; None: as it is

    @property
    def num_gates(self) -> int:
        """Number of gates in a lap."""
        return self.position_w.shape[1]


class Opening(NamedTuple):
    """One gate of a course, or for every drone its own."""

    position_w: Float[Array, "3 *B"]  # centre [m]
    normal_w: Float[Array, "2 *B"]
    half_size: Float[Array, "2 *B"]  # [m]
    tilt: Float[Array, "4 *B"] | None = None
    is_round: Bool[Array, "1 *B"] | None = None
    later: "Opening | None" = None  # at the end of the step that is judged; None: as it is


def make_course(track: Track) -> Course:
    """Arrays of a track, gates that move where they are at rest."""
    gates = track.gates
    yaw = np.array([g.yaw for g in gates])
    return Course(
        position_w=jnp.array([g.position_w for g in gates], jnp.float32).T,
        normal_w=jnp.array([np.cos(yaw), np.sin(yaw)], jnp.float32),
        half_size=jnp.array([_half_size(g) for g in gates], jnp.float32).T,
        frame_width=jnp.float32(track.frame_width),
        bounds_low=jnp.array(track.bounds_low, jnp.float32),
        bounds_high=jnp.array(track.bounds_high, jnp.float32),
        leave_distance=jnp.float32(track.leave_distance),
        tilt=_tilt(gates),
        is_round=jnp.array([[g.shape == "round" for g in gates]]) if any(g.shape == "round" for g in gates) else None,
        half_depth=jnp.float32(track.frame_depth / 2) if track.frame_depth else None,
        solids={kind: jnp.array(table, jnp.float32) for kind, table in solid_columns(track.obstacles).items()} or None,
        motions=_motions(track) if track.moves else None,
    )


def _motions(track: Track) -> Motions:
    rows = np.array([motion_row(gate.motion) for gate in track.gates]).T
    sway, swing, period, phase = rows[:3], rows[3], rows[4], rows[5]
    return Motions(
        jnp.array(sway, jnp.float32),
        jnp.array(swing, jnp.float32) if swing.any() else None,
        jnp.array(np.where(period > 0, period, 1.0), jnp.float32),
        jnp.array(phase / (2 * np.pi) % 1.0, jnp.float32),
    )


def course_at(course: Course, time: Float[Array, "*B"] | float) -> Course:
    """A course whose gates are at rest, with the gates where they stand at a time [s], of each race its own."""
    motions = course.motions
    if motions is None:
        return course
    time = jnp.asarray(time)

    def each(table: Array) -> Array:
        """With an axis for every one of the races after that of the gates."""
        return table.reshape(*table.shape, *(1,) * time.ndim)

    turns = time / each(motions.period)
    share = sin_cos(2 * math.pi * (turns - jnp.floor(turns) + each(motions.turns)))[0]
    at_rest = course.position_w, course.normal_w
    position, normal = (each(table) if table.ndim == 2 else table for table in at_rest)
    if motions.swing is not None:
        sine, cosine = sin_cos(each(motions.swing) * share)
        normal = jnp.stack([cosine * normal[0] - sine * normal[1], sine * normal[0] + cosine * normal[1]])
    position = position + each(motions.sway_w) * share
    return course._replace(position_w=position, normal_w=jnp.broadcast_to(normal, (2, *position.shape[1:])))


def _half_size(gate: Gate) -> tuple[float, float]:
    return gate.width / 2, (gate.width if gate.shape == "round" else gate.height) / 2


def _tilt(gates: tuple[Gate, ...]) -> Float[Array, "4 G"] | None:
    roll, pitch = np.array([g.roll for g in gates]), np.array([g.pitch for g in gates])
    if not (roll.any() or pitch.any()):
        return None
    return jnp.array([np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)], jnp.float32)


def opening(course: Course, gate: int | Int[Array, ""]) -> Opening:
    """One gate, the same for all drones."""
    return _opening(course, lambda table: table[:, gate])


def target_opening(course: Course, gate: Int[Array, "*B"]) -> Opening:
    """For every drone the gate of its number."""
    return _opening(course, lambda table: pick(table, gate))


def _opening(course: Course, column: Callable[[Array], Array]) -> Opening:
    return Opening(
        column(course.position_w),
        column(course.normal_w),
        column(course.half_size),
        None if course.tilt is None else column(course.tilt),
        None if course.is_round is None else column(course.is_round),
        None if course.later is None else _opening(course.later, column),
    )


def pick(table: Shaped[Array, "C G *R"], gate: Int[Array, "*B"]) -> Shaped[Array, "C *B"]:
    """Columns of `table` at `gate`, axes R the last of B.

    A sum over selects, which vectorises where a gather does not, up to `UNROLLED` gates; beyond, a gather.
    """
    races = table.shape[2:]
    if is_plain() and not races:
        return table.take(gate, axis=1, mode="clip")
    ones = (1,) * (gate.ndim - len(races))
    if table.shape[1] > UNROLLED:
        spread = table.reshape(*table.shape[:2], *ones, *races)
        return jnp.take_along_axis(spread, gate[None, None], axis=1)[:, 0]
    columns = [table[:, g].reshape(-1, *ones, *races) for g in range(table.shape[1])]
    picked = jnp.broadcast_to(columns[0], (table.shape[0], *gate.shape))
    for g, column in enumerate(columns[1:], start=1):
        picked = jnp.where(gate == g, column, picked)
    return picked


def over_columns(count: int, visit: Callable[[Any, Any], Any], start: Any) -> Any:
    """Fold `visit(result, number)` over the numbers of gates or solids; what is traced does not grow beyond a few."""
    if count <= UNROLLED:
        return functools.reduce(visit, range(count), start)
    result, _ = jax.lax.scan(lambda carry, number: (visit(carry, number), None), start, jnp.arange(count))
    return result
