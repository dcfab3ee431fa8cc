"""What the racing observation adds to `body`, against an independent transcription."""

import functools

import numpy as np
import pytest

from cruise.dynamics import DroneState
from cruise.env.types import RaceState
from cruise.racing.random_track import random_track
from tests.env.races import RANDOM_RACES, RING, race_env, random_race
from tests.helpers import yaw_matrix

TRACKS = {"ring": RING, "random": random_track(3, difficulty=1.0)}


@functools.cache
def seen_on(track: str, kind: str = "racing") -> tuple[RaceState, dict[str, np.ndarray]]:
    """Random races of four, some drones out, and what all see, by term."""
    env = race_env(4, TRACKS[track])
    state = random_race(env, spread=4.0, out=0.3)
    return state, by_term(env, state, kind)


def by_term(env: object, state: RaceState, kind: str) -> dict[str, np.ndarray]:
    """An observation, [K, N, E] by the name of its term, times its scale."""
    numbers, found, first = np.asarray(env.observe_as[kind](state)), {}, 0
    for entry in env.layout(kind):
        found[entry.name] = numbers[first : first + entry.size] * entry.scale
        first += entry.size
    assert first == len(numbers)
    return found


def axes_of(gate: object) -> np.ndarray:
    """Forward, left and up of an upright gate, as rows."""
    return yaw_matrix(gate.yaw).T


def rotation_of(euler: np.ndarray) -> np.ndarray:
    roll, pitch, yaw = euler
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    about_y, about_x = [[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]], [[1, 0, 0], [0, cr, -sr], [0, sr, cr]]
    return yaw_matrix(yaw) @ np.array(about_y) @ np.array(about_x)


def expected_of(track: str, state: RaceState, i: int, e: int) -> dict[str, np.ndarray]:
    """What drone i of race e sees of gates and opponents, in SI units."""
    gates, body = TRACKS[track].gates, state.drones.body
    place, speed, euler = (np.asarray(v, np.float64)[..., e] for v in (body.position_w, body.velocity_w, body.euler))
    to_body, target = rotation_of(euler[:, i]).T, int(state.next_gate[i, e])
    told = {}
    for name, ahead in (("gate_1", 0), ("gate_2", 1), ("last_gate", -1)):
        gate = gates[(target + ahead) % len(gates)]
        offset, axes = np.array(gate.position_w) - place[:, i], axes_of(gate)
        own = -axes @ offset
        told[f"{name}_normal"], told[f"{name}_place"] = to_body @ axes[0], own
        told[f"{name}_edges"] = np.abs(own[1:]) - [gate.width / 2, gate.height / 2]
        if ahead >= 0:
            told[f"{name}_direction"] = to_body @ offset / np.linalg.norm(offset)
    gate = gates[target]
    told["motion_at_gate"] = axes_of(gate) @ speed[:, i]
    told["nearness"] = [1 / (0.5 + np.linalg.norm(np.array(gate.position_w) - place[:, i]))]
    others = [j for j in range(4) if j != i and bool(state.airborne[j, e])]
    others.sort(key=lambda j: np.linalg.norm(place[:, j] - place[:, i]))
    for number in range(1, 4):
        told |= dict.fromkeys([f"opponent_{number}_{what}" for what in ("place", "opening", "nearness")], 0.0)
    for number, j in enumerate(others, start=1):
        offset, distance = place[:, j] - place[:, i], np.linalg.norm(place[:, j] - place[:, i])
        told[f"opponent_{number}_place"] = axes_of(gate) @ (place[:, j] - gate.position_w)
        told[f"opponent_{number}_opening"] = offset @ (speed[:, j] - speed[:, i]) / max(distance, 0.1)
        told[f"opponent_{number}_nearness"] = 1 / (0.3 + distance)
    return told


@pytest.mark.parametrize("track", TRACKS)
def test_every_term_is_what_it_says(track: str) -> None:
    state, seen = seen_on(track)
    env = race_env(4, TRACKS[track])
    scales = {entry.name: entry.scale for entry in env.layout("racing")}
    for e in range(0, RANDOM_RACES, 7):
        for i in range(4):
            for name, value in expected_of(track, state, i, e).items():
                clipped = np.clip(value, -3 * scales[name], 3 * scales[name])
                np.testing.assert_allclose(seen[name][:, i, e], clipped, atol=2e-4, err_msg=name)


def test_it_begins_with_what_body_tells() -> None:
    state, seen = seen_on("random")
    for name, value in by_term(race_env(4, TRACKS["random"]), state, "body").items():
        np.testing.assert_array_equal(seen[name], value)


def test_a_value_network_sees_the_same_and_more_gates() -> None:
    state, seen = seen_on("random")
    far = by_term(race_env(4, TRACKS["random"]), state, "racing-far")
    assert far.keys() > seen.keys()
    for name, value in seen.items():
        np.testing.assert_array_equal(far[name], value)


def test_racing_near_is_the_same_but_that_who_is_far_away_fades() -> None:
    """Whole within 3 m, gone beyond 6 m, in proportion between; of the rest every number is the same."""
    (_, seen), (_, near) = seen_on("random"), seen_on("random", "racing-near")
    scales = {entry.name: entry.scale for entry in race_env(4, TRACKS["random"]).layout("racing")}
    assert near.keys() == seen.keys()
    distance = 1 / np.maximum(np.stack([seen[f"opponent_{k}_nearness"][0] for k in (1, 2, 3)]), 1e-6) - 0.3
    share = np.interp(distance, [3.0, 6.0], [1.0, 0.0])
    assert all(((share == 0) & (distance < 1e3)).any(axis=(1, 2)))
    assert (share == 1).any()
    for name, value in seen.items():
        _, _, number = name.partition("opponent_")
        faded = share[int(number[0]) - 1] if number else 1.0
        inside = np.abs(value) < 2.99 * scales[name]  # numbers are clipped after they fade
        np.testing.assert_allclose(near[name][inside], (faded * value)[inside], atol=1e-3, err_msg=name)


def test_alone_opponents_are_zeros() -> None:
    env = race_env(1)
    seen = by_term(env, random_race(env), "racing")
    assert not any(np.any(value) for name, value in seen.items() if name.startswith("opponent_"))


def test_opening_is_how_distance_changes() -> None:
    """A little later, everybody having flown straight on, the nearest is so much farther away."""
    env, dt = race_env(2), 1e-3
    state = random_race(env, spread=4.0, out=0.0)
    body = state.drones.body
    moved = body._replace(position_w=body.position_w + dt * body.velocity_w)
    later = state._replace(drones=DroneState(moved, state.drones.memory))
    before, after = (by_term(env, one, "racing") for one in (state, later))
    distance = [1 / one["opponent_1_nearness"] - 0.3 for one in (before, after)]
    slow = (np.abs(before["opponent_1_opening"]) < 14) & (distance[0] > 1) & (distance[0] < 5)
    assert slow.mean() > 0.1
    growth = (distance[1] - distance[0]) / dt
    np.testing.assert_allclose(growth[slow], before["opponent_1_opening"][slow], atol=0.15)
