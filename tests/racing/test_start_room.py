"""Starts lie within the track and off its solids, or are refused in one line."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Gate, Pole, StartLine, Track, Wall
from cruise.env.race_env import make_race_env
from cruise.errors import CruiseError
from cruise.presets import TRACKS
from cruise.racing.contacts import meet_solids, out_of_bounds
from cruise.racing.course import make_course
from cruise.racing.grid import Start, spread_start, start_grid
from cruise.racing.start_room import spread_plan, start_plan
from cruise.vehicles import find_vehicle

DRAWS = 400
SHUTTLE = (Gate((-4.0, 0.0, 2.0), np.pi), Gate((4.0, 0.0, 2.0), 0.0))
HALL = Track("hall", SHUTTLE, (-6.0, -4.0, 0.0), (6.0, 4.0, 4.0))
TIGHT = dataclasses.replace(HALL, gates=(Gate((3.0, 0.0, 2.0), np.pi), Gate((-3.0, 0.0, 2.0), np.pi)))
POLES = tuple(Pole((2.0 * k - 6.0, y, 0.0), 3.0, 0.1) for k in range(7) for y in (-1.3, 1.3))


def draw(track: Track, drones: int) -> Start:
    plan = start_plan(track, drones)
    start = jax.jit(lambda key: start_grid(make_course(track), key, drones, (DRAWS,), plan=plan))(jax.random.key(0))
    return Start(*(np.asarray(part) for part in start))


CASES = {
    "the room before a gate is short": (TIGHT, 4),
    "a large field on a small track": (HALL, 8),
    "poles where lanes would be": (dataclasses.replace(HALL, obstacles=POLES), 3),
    "twenty on split-s": (TRACKS["split-s"], 20),
    "sixty-four on the ring": (TRACKS["ring"], 64),
    "places": (TRACKS["uzh-2026"], 8),
    "a line": (dataclasses.replace(HALL, start=StartLine((0.0, 0.0, 1.0), np.pi / 2, 1.0)), 7),
}


@pytest.mark.parametrize("case", CASES)
def test_nobody_starts_outside_or_in_a_solid_or_on_another(case: str) -> None:
    track, drones = CASES[case]
    course, position = make_course(track), jnp.asarray(draw(track, drones).position_w)
    assert not np.asarray(out_of_bounds(course, position)).any()
    assert (position[2] > 0).all()
    assert all((np.asarray(met) > 1).all() for met in meet_solids(course, position, position).values())
    apart = np.linalg.norm(position[:, :, None] - position[:, None], axis=0) + 9 * np.eye(drones)[..., None]
    assert apart.min() > 0.5


def test_gates_without_room_are_no_first_gates() -> None:
    start = draw(TIGHT, 4)
    assert set(start.gate.tolist()) == {0, 1}
    walled = dataclasses.replace(TIGHT, obstacles=(Wall((4.6, 0.0, 2.0), (0.2, 8.0, 4.0)),))
    assert set(draw(walled, 2).gate.tolist()) == {1}


def test_the_places_of_a_track_are_dealt_out_by_chance() -> None:
    track = TRACKS["uzh-2026"]
    start = draw(track, 4)
    places = np.array([place.position_w for place in track.start.places[:4]])
    nearest = np.linalg.norm(start.position_w[:, :, None] - places.T[:, None, :, None], axis=0).argmin(axis=1)
    assert (np.sort(nearest, axis=0) == np.arange(4)[:, None]).all()
    assert all(0.15 < (nearest[0] == place).mean() < 0.35 for place in range(4))
    assert (start.gate == 0).all()


@pytest.mark.parametrize(
    ("track", "drones", "message"),
    [
        (TRACKS["uzh-2026"], 9, "uzh-2026 has places for 8 drones to start from, not for 9"),
        (HALL, 90, "hall has no gate with room for 90 drones to start: race fewer"),
        (CASES["a line"][0], 40, "hall has no room for 40 drones on its start line: race fewer"),
    ],
)
def test_too_many_drones_are_refused_in_one_line(track: Track, drones: int, message: str) -> None:
    with pytest.raises(CruiseError) as caught:
        start_plan(track, drones)
    assert str(caught.value) == message


@pytest.mark.parametrize(("track", "drones"), [("ring", 1), ("ring", 8), ("uzh-2026", 4), ("split-s", 13)])
def test_spread_starts_are_one_by_one_before_every_gate_with_room_or_in_file(track: str, drones: int) -> None:
    plan = spread_plan(TRACKS[track], drones)
    assert plan is not None
    start = spread_start(make_course(TRACKS[track]), jax.random.key(1), drones, (500,), plan)
    position, gate = np.asarray(start.position_w), np.asarray(start.gate)
    assert set(np.unique(gate)) == set(plan.gates)
    for i, j in itertools.combinations(range(drones), 2):
        apart = np.linalg.norm(position[:, i] - position[:, j], axis=0)
        assert apart[gate[i] == gate[j]].min(initial=np.inf) > 1.3
        assert apart.min() > 1.0
    waiting = {int(np.bincount(column).max()) for column in gate.T}
    assert waiting == {-(-drones // len(plan.gates))}  # as few in a file as there can be
    gates = TRACKS[track].gates
    centre = np.array([g.position_w for g in gates])[gate]
    normal = np.array([(np.cos(g.yaw), np.sin(g.yaw)) for g in gates])[gate]
    offset = np.moveaxis(position, 0, 2) - centre
    forward = (offset[..., :2] * normal).sum(axis=2)
    assert forward.max() < -1.3  # before the gate
    np.testing.assert_allclose(np.linalg.norm(offset[..., :2] - forward[..., None] * normal, axis=2), 0.0, atol=0.12)


def test_no_room_for_a_file_anywhere_leaves_every_gate() -> None:
    assert spread_plan(dataclasses.replace(TRACKS["ring"], leave_distance=1.0), 2) is None


def test_a_share_of_races_starts_spread() -> None:
    env = make_race_env(TRACKS["ring"], 3, find_vehicle("paper"))
    gates = np.asarray(env.reset(jax.random.key(0), (400,), spread=0.3).next_gate)
    together = (gates == gates[0]).all(axis=0).mean()
    assert together == pytest.approx(0.7, abs=0.07)
