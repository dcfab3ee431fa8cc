"""What a pilot in plain Python sees of a race: NumPy arrays, SI units, the world's frame."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cruise import geometry
from cruise.config import Gate
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.racing.course import Course


class Gates(NamedTuple):
    """The gates of the track in the order of flight; world frame, z up."""

    position_w: np.ndarray  # [G, 3] centres of the openings [m]
    yaw: np.ndarray  # [G] heading of the normal, the direction of flight [rad]
    normal_w: np.ndarray  # [G, 3] the direction of flight: (cos yaw, sin yaw, 0) for a gate that stands upright
    width: np.ndarray  # [G] of the opening [m]
    height: np.ndarray  # [G] of the opening [m]
    roll: np.ndarray  # [G] about the normal [rad]
    pitch: np.ndarray  # [G] of the normal below the horizon [rad]
    is_round: np.ndarray  # [G] bool: the opening is a circle as wide as `width`


class View(NamedTuple):
    """What a pilot sees when it is asked for an action.

    `act(view)` is asked for one drone of one race: shapes are as below. `act_batch(view)` is asked for all drones of
    all races that the pilot flies at once, M of them, in the same order every time: each array but those of `gates` has
    a leading axis M. So have `position_w`, `yaw` and `normal_w` of the gates where these move, as they stand now, or
    where drones know them by sight alone.
    """

    time: float | np.ndarray  # since the start; 0 at a pilot's first step [s]
    drone: int | np.ndarray  # which one it flies, counted from 0
    position_w: np.ndarray  # [3] m
    velocity_w: np.ndarray  # [3] m/s
    euler: np.ndarray  # [3] roll, pitch, yaw (ZYX) [rad]
    rotation_wb: np.ndarray  # [3, 3] turns the body's vectors (forward, left, up) into the world's
    angular_velocity_b: np.ndarray  # [3] about the body's axes [rad/s]
    next_gate: int | np.ndarray  # index of the gate to pass next
    gates_passed: int | np.ndarray  # since the start
    airborne: bool | np.ndarray  # still racing; `act` is asked only while it is
    others_position_w: np.ndarray  # [N-1, 3] of the other drones, from the next in number on and around [m]
    others_velocity_w: np.ndarray  # [N-1, 3] m/s
    others_airborne: np.ndarray  # [N-1] bool: who is not has left the air and obstructs nobody
    observation: np.ndarray | None  # [O] of the kind that the pilot's attribute `observation` names, or None
    gates: Gates
    control_dt: float  # between two actions [s]
    agility: float  # scale of the action [m/s^2 in the paper's vehicle]


class Snapshot(NamedTuple):
    """All drones of all races at one moment. Leading axes [E, N]."""

    time: np.ndarray  # [E] s
    position_w: np.ndarray
    velocity_w: np.ndarray
    euler: np.ndarray
    rotation_wb: np.ndarray
    angular_velocity_b: np.ndarray
    next_gate: np.ndarray
    gates_passed: np.ndarray
    airborne: np.ndarray
    observations: dict[str, np.ndarray]  # by kind
    others: "Others | None" = None  # as each drone perceives them; None: as they are
    gates: tuple[np.ndarray, np.ndarray] | None = None  # centres [E, N, G, 3] and headings [E, N, G, 2], likewise


class Others(NamedTuple):
    """Opponents of all drones of all races, from the next in number on and around. Leading axes [E, N, N-1]."""

    position_w: Any
    velocity_w: Any
    airborne: Any


def _row(gates: Gates, row: int) -> Gates:
    """Of gates that are believed to be elsewhere in every row, those of one."""
    own = {name: getattr(gates, name)[row] for name in ("position_w", "yaw", "normal_w")}
    return gates._replace(**own)


def gates_of(course: Course, gates: Sequence[Gate]) -> Gates:
    """The gates of a course, and the tilt and shape that its track gives them, as a pilot sees them."""
    x, y = np.asarray(course.normal_w, np.float64)
    width, height = 2 * np.asarray(course.half_size, np.float64)
    tilts = [geometry.tilt_of(gate.roll, gate.pitch) for gate in gates]
    normal_w = [geometry.from_gate(heading, (1.0, 0.0, 0.0), tilt) for *heading, tilt in zip(x, y, tilts, strict=True)]
    return Gates(
        np.asarray(course.position_w, np.float64).T,
        np.arctan2(y, x),
        np.array(normal_w),
        width,
        height,
        roll=np.array([gate.roll for gate in gates]),
        pitch=np.array([gate.pitch for gate in gates]),
        is_round=np.array([gate.shape == "round" for gate in gates]),
    )


def take_snapshot(env: RaceEnv, state: RaceState, kinds: tuple[str, ...]) -> Snapshot:
    """See races [*B]; `kinds` are the observations that somebody asks for."""
    vectors, flags, observations, others, gates = jax.tree.map(np.asarray, _take_snapshot(env, state, kinds))
    passed_time = flags.pop("step") * env.dynamics.control_dt
    floats = {name: np.asarray(value, np.float64) for name, value in vectors.items()}
    return Snapshot(time=passed_time, **floats, **flags, observations=observations, others=others, gates=gates)


@eqx.filter_jit
def _take_snapshot(env: RaceEnv, state: RaceState, kinds: tuple[str, ...]) -> tuple[Any, ...]:
    batch = state.step.ndim

    def users(values: Array) -> Array:
        """[C, N, *B] -> [E, N, C], [N, *B] -> [E, N] and [*B] -> [E]; the order of all axes is turned around."""
        return values.reshape(*values.shape[: values.ndim - batch], -1).T

    def of_all(table: Array) -> Array:
        """[C, G, *B] of all drones as [C, G, N, *B]."""
        shape = (*table.shape[:2], *state.airborne.shape)
        return table if table.ndim == len(shape) else jnp.broadcast_to(table[:, :, None], shape)

    drones = state.drones
    vectors = {
        "position_w": users(drones.position_w),
        "velocity_w": users(drones.velocity_w),
        "euler": users(env.dynamics.euler(drones)),
        "rotation_wb": users(env.dynamics.rotation(drones)).swapaxes(-1, -2),
        "angular_velocity_b": users(drones.angular_velocity_b),
    }
    flags = {name: users(getattr(state, name)) for name in ("step", "next_gate", "gates_passed", "airborne")}
    others = None if state.opponents is None else Others(*map(users, state.opponents))
    surroundings = state.surroundings
    shown = surroundings.gates if surroundings.sensed is not None or surroundings.rest is not None else None
    gates = None if shown is None else tuple(users(of_all(table)) for table in (shown.position_w, shown.normal_w))
    return vectors, flags, {kind: users(env.observe_as[kind](state)) for kind in kinds}, others, gates


class ViewBuilder(NamedTuple):
    """Gives each drone of a crew its view."""

    gates: Gates
    control_dt: float
    agility: float
    observation: str | None

    def views(self, snapshot: Snapshot, drones: Sequence[int]) -> View:
        """The views of some drones in every race, M = n E rows, drone after drone."""
        total = snapshot.airborne.shape[1]
        parts = [self._columns(snapshot, drone, [(drone + k) % total for k in range(1, total)]) for drone in drones]
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        return self._view(columns)._replace(gates=self._believed(snapshot, drones))

    def one_by_one(self, views: View, wanted: np.ndarray) -> Iterator[tuple[int, View]]:
        """Each wanted row of a batch of views, with its number; plain numbers where a row has one number."""
        columns = [column for column in views if isinstance(column, np.ndarray)]
        plain = [column.tolist() if column.ndim == 1 else column for column in columns]
        for row in np.flatnonzero(wanted).tolist():
            gates = views.gates if views.gates.yaw.ndim == 1 else _row(views.gates, row)
            yield row, self._view([column[row] for column in plain])._replace(gates=gates)

    def _view(self, columns: Sequence[Any]) -> View:
        """`columns` in the order of the view's fields; the observation only where it is asked for."""
        names = View._fields[: len(columns)]
        named = {"observation": None} | dict(zip(names, columns, strict=True))
        return View(**named, gates=self.gates, control_dt=self.control_dt, agility=self.agility)

    def _believed(self, snapshot: Snapshot, drones: Sequence[int]) -> Gates:
        """The gates of the map, or in every row as they stand now, or as its drone believes them."""
        if snapshot.gates is None:
            return self.gates
        position, heading = (
            np.concatenate([table[:, drone] for drone in drones]).astype(np.float64) for table in snapshot.gates
        )
        tilts = [geometry.tilt_of(roll, pitch) for roll, pitch in zip(self.gates.roll, self.gates.pitch, strict=True)]
        normal = [
            np.stack(
                np.broadcast_arrays(*geometry.from_gate(tuple(heading[:, gate].T), (1.0, 0.0, 0.0), tilt)), axis=-1
            )
            for gate, tilt in enumerate(tilts)
        ]
        yaw = np.arctan2(heading[..., 1], heading[..., 0])
        return self.gates._replace(position_w=position, yaw=yaw, normal_w=np.stack(normal, axis=1))

    def _columns(self, snapshot: Snapshot, drone: int, others: list[int]) -> tuple[np.ndarray, ...]:
        told = snapshot.others
        others_are = (
            (snapshot.position_w[:, others], snapshot.velocity_w[:, others], snapshot.airborne[:, others])
            if told is None
            else (told.position_w[:, drone], told.velocity_w[:, drone], told.airborne[:, drone])
        )
        columns = (
            snapshot.time,
            np.full(len(snapshot.time), drone),
            snapshot.position_w[:, drone],
            snapshot.velocity_w[:, drone],
            snapshot.euler[:, drone],
            snapshot.rotation_wb[:, drone],
            snapshot.angular_velocity_b[:, drone],
            snapshot.next_gate[:, drone],
            snapshot.gates_passed[:, drone],
            snapshot.airborne[:, drone],
            *others_are,
        )
        return columns if self.observation is None else (*columns, snapshot.observations[self.observation][:, drone])
