"""A person as a pilot: what sticks mean, from a drone that flies itself to one that is told its body rates."""

import math
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from cruise.config import Vehicle
from cruise.dynamics import FreeBody, Reference
from cruise.dynamics.attitude import AttitudeSetpoint, attitude_loop, heading_of
from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.pilots.base import Memory
from cruise.pilots.scripted import EPSILON, FLOOR, aim_point, push_apart
from cruise.racing.field import rows
from cruise.vector import norm
from cruise.vehicles import find_vehicle

MODES = ("hold", "assisted", "angle", "acro")
HOLD, ASSISTED, ANGLE, ACRO = range(len(MODES))
HUMAN = "human"  # what names of people in race logs begin with

LEAD = 0.5  # assisted: aims this share of its distance in front of the gate
ASIDE = 0.5  # assisted: sideways and upwards, of the forward speed
LOOK = 0.7  # assisted: the nose turns away from the way at full yaw [rad]
CLEARANCE, PUSH = 1.5, 2.0  # assisted: gives way to drones nearer than this [m], so strongly [1/s]


class Controls(NamedTuple):
    """What a person tells a drone, arrays [..., n, *B] for n drones."""

    sticks: Float[Array, "4 n *B"]  # roll right, pitch forward, yaw right, throttle up, in [-1, 1]
    mode: Int[Array, "n *B"]  # index into `MODES`
    rates: Float[Array, "3 3 n *B"]  # of roll, pitch, yaw: at the centre, at full stick [rad/s], expo in [0, 1]
    tilt: Float[Array, "n *B"]  # at full stick in angle mode [rad]
    speed: Float[Array, "n *B"]  # at full stick in assisted mode [m/s]
    centred: Float[Array, "n *B"]  # 1: the throttle stick hovers in its middle; 0: it is linear from none to all


def flight_modes(vehicle: Vehicle) -> tuple[str, ...]:
    """Ways in which a person can fly a vehicle, the easiest first: what its action can say."""
    modes = {"ctbr": ("assisted", "angle", "acro"), "attitude": ("assisted", "angle")}
    return modes.get(vehicle.control, ("assisted",)) if vehicle.told_directly else ("assisted",)


class HumanPilot(eqx.Module):
    """Flies by the sticks in its memory, which somebody outside puts there; holds its place until then."""

    name: str = eqx.field(static=True)
    agility: float = eqx.field(static=True)
    vehicle: str | Vehicle = eqx.field(static=True)

    def init(self, env: RaceEnv, drones: tuple[int, ...], state: RaceState) -> Memory:
        """Sticks in the middle, and the drone on hold."""
        shape = (len(drones), *state.step.shape)
        none = jnp.zeros(shape, jnp.float32)
        return Controls(
            sticks=jnp.zeros((4, *shape), jnp.float32),
            mode=jnp.full(shape, HOLD, jnp.int32),
            rates=jnp.zeros((3, 3, *shape), jnp.float32),
            tilt=none,
            speed=none,
            centred=none,
        )

    def act(
        self, env: RaceEnv, drones: tuple[int, ...], memory: Memory, state: RaceState, key: Array
    ) -> tuple[Memory, Float[Array, "A n *B"]]:
        """What the sticks mean in the mode that is flown."""
        del key
        told: Controls = memory
        action = rows(self._tracked(env, drones, told, state), drones, axis=1)
        if "angle" in flight_modes(env.vehicle):
            action = jnp.where(told.mode >= ANGLE, self._by_attitude(env.vehicle, drones, told, state), action)
        if "acro" in flight_modes(env.vehicle):
            action = jnp.where(told.mode == ACRO, self._by_rates(env.vehicle, told), action)
        return told, jnp.clip(action, -1.0, 1.0)

    def _tracked(self, env: RaceEnv, drones: tuple[int, ...], told: Controls, state: RaceState) -> Array:
        """Hold: stand still. Assisted: forward is along the way through the next gate; all drones, [A, N, *B]."""
        position = state.drones.position_w
        to_aim = aim_point(env.course_of(state), state.next_gate, position, LEAD) - position
        ahead = to_aim / (norm(to_aim) + EPSILON)
        roll, pitch, yaw, throttle = _everybody(told.sticks, drones, env.num_drones, axis=1)
        speed = _everybody(told.speed, drones, env.num_drones)
        level = ahead / (norm(ahead[:2]) + EPSILON)
        right = jnp.stack([level[1], -level[0], jnp.zeros_like(level[0])])
        wanted = speed * (pitch * ahead + ASIDE * roll * right)
        wanted = wanted.at[2].add(ASIDE * speed * throttle)
        wanted += push_apart(position, state.airborne, CLEARANCE, PUSH)
        wanted = wanted.at[2].max(FLOOR - position[2])
        assisted = _everybody(told.mode, drones, env.num_drones) == ASSISTED
        heading = jnp.arctan2(ahead[1], ahead[0]) - LOOK * yaw
        own = jnp.arctan2(*env.dynamics.rotation(state.drones)[1::-1, 0])
        reference = Reference(velocity_w=jnp.where(assisted, wanted, 0.0), heading=jnp.where(assisted, heading, own))
        return env.dynamics.track(state.drones, reference, self.agility)

    def _by_attitude(self, vehicle: Vehicle, drones: tuple[int, ...], told: Controls, state: RaceState) -> Array:
        """Roll and pitch are angles, yaw is a rate."""
        assert vehicle.airframe is not None
        roll, pitch, _, _ = told.sticks
        assert isinstance(state.drones.body, FreeBody)
        attitude = tuple(rows(jnp.asarray(state.drones.body.attitude), drones, axis=1))
        thrust, turn = self._thrust(vehicle, told), -stick_rate(told.sticks[2], told.rates[2])
        if vehicle.control == "attitude":
            limits = vehicle.airframe.attitude
            number = turn / vehicle.airframe.rates.highest[2]
            if limits.yaw == "angle":
                number = heading_of(attitude) / math.pi + turn / (math.pi * vehicle.tracking.attitude_gain)
            angles = [roll * told.tilt / limits.highest_tilt, pitch * told.tilt / limits.highest_tilt]
            return jnp.stack([*angles, number, 2 * thrust / self.agility - 1])
        asked = AttitudeSetpoint(thrust, roll * told.tilt, pitch * told.tilt, turn)
        rates = attitude_loop(vehicle, asked, attitude).rates_b
        return self._told(vehicle, thrust, rates)

    def _by_rates(self, vehicle: Vehicle, told: Controls) -> Array:
        """Every stick is a body rate, the throttle is the thrust."""
        roll, pitch, yaw = (stick_rate(told.sticks[axis], told.rates[axis]) for axis in range(3))
        return self._told(vehicle, self._thrust(vehicle, told), (roll, pitch, -yaw))

    def _told(self, vehicle: Vehicle, thrust: Array, rates: tuple[Array, ...]) -> Array:
        assert vehicle.airframe is not None
        turns = [rate / highest for rate, highest in zip(rates, vehicle.airframe.rates.highest, strict=True)]
        return jnp.stack([2 * thrust / self.agility - 1, *turns])

    def _thrust(self, vehicle: Vehicle, told: Controls) -> Array:
        """Collective thrust per mass [m/s^2]."""
        throttle, hover = told.sticks[3], vehicle.gravity
        centred = hover + throttle * jnp.where(throttle < 0, hover, self.agility - hover)
        return jnp.where(told.centred > 0, centred, self.agility * (throttle + 1) / 2)


def stick_rate(stick: Array, rate: Array) -> Array:
    """Betaflight's "actual" rates: s c + max(m - c, 0) |s| (s^5 e + s (1 - e)) for centre c, maximum m and expo e."""
    centre, most, expo = rate
    curve = jnp.abs(stick) * (stick**5 * expo + stick * (1 - expo))
    return stick * centre + jnp.maximum(most - centre, 0.0) * curve


def human_pilot(vehicle: str | Vehicle, name: str = HUMAN) -> HumanPilot:
    """Whoever sits at the sticks of a vehicle."""
    return HumanPilot(name, find_vehicle(vehicle).agility, vehicle)


def _everybody(values: Array, drones: tuple[int, ...], count: int, axis: int = 0) -> Array:
    """Values of some drones in the places of all, zeros for the others."""
    shape = (*values.shape[:axis], count, *values.shape[axis + 1 :])
    at = (slice(None),) * axis + (jnp.array(drones),)
    return jnp.zeros(shape, values.dtype).at[at].set(values)
