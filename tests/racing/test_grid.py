"""The start grid: laws over thousands of draws, for 1 to 16 drones on three tracks."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Track
from cruise.presets import TRACKS
from cruise.racing.contacts import out_of_bounds
from cruise.racing.course import make_course
from cruise.racing.grid import LANES, MIN_HEIGHT, Start, start_grid
from tests.helpers import random_track

TRACKS_BY_NAME = {**TRACKS, "random": random_track(7, gates=5)}
DRAWS = 2000


@functools.cache
def _starter(drones: int) -> object:
    return jax.jit(lambda course, key: start_grid(course, key, drones, (DRAWS,)))


def draw(track: Track, drones: int, seed: int = 0) -> Start:
    """DRAWS grids: position_w [3, N, DRAWS], heading [N, DRAWS], gate [DRAWS]."""
    return Start(*(np.asarray(part) for part in _starter(drones)(make_course(track), jax.random.key(seed))))


def in_gate_frame(track: Track, start: Start) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forward of, left of and above the gate, [N, DRAWS] each."""
    centre = np.array([g.position_w for g in track.gates])[start.gate].T[:, None]
    yaw = np.array([g.yaw for g in track.gates])[start.gate]
    x, y, z = start.position_w - centre
    return np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x, z


def smallest_separation(start: Start) -> float:
    """Of any two drones of any draw; infinite for one drone [m]."""
    p = start.position_w
    pairs = [np.linalg.norm(p[:, i] - p[:, j], axis=0).min() for i in range(p.shape[1]) for j in range(i)]
    return min(pairs, default=np.inf)


@pytest.mark.parametrize("drones", range(1, 17))
@pytest.mark.parametrize("name", ["ring", "random"])
def test_no_two_drones_start_closer_than_a_metre(name: str, drones: int) -> None:
    start = draw(TRACKS_BY_NAME[name], drones)
    assert start.position_w.shape == (3, drones, DRAWS)
    assert smallest_separation(start) > 1.0


@pytest.mark.parametrize("drones", [1, 3, 4, 6, 16])
@pytest.mark.parametrize("name", TRACKS_BY_NAME)
def test_starts_upstream_above_ground_and_on_the_track(name: str, drones: int) -> None:
    track = TRACKS_BY_NAME[name]
    start = draw(track, drones)
    forward, left, _ = in_gate_frame(track, start)
    assert forward.max() < -1.3
    assert forward.min() > -8.0
    assert np.abs(left).max() < 2.0
    assert start.position_w[2].min() >= MIN_HEIGHT
    assert not np.asarray(out_of_bounds(make_course(track), jnp.asarray(start.position_w))).any()
    assert smallest_separation(start) > 1.0
    headings = np.array([g.yaw for g in track.gates])[start.gate]
    np.testing.assert_allclose(np.cos(start.heading - headings), 1, atol=1e-6)


@pytest.mark.parametrize("drones", [1, 2, 4, 6, 16])
def test_every_drone_reaches_every_slot_equally(drones: int) -> None:
    """Slots by row and lane of drone 0, read from the drawn positions alone."""
    forward, left, _ = in_gate_frame(TRACKS_BY_NAME["ring"], draw(TRACKS_BY_NAME["ring"], drones))
    first_row = forward.max(axis=0)
    rows = np.rint((first_row - forward) / 1.5).astype(int)
    slot = np.argsort(np.argsort(left + 1000 * rows, axis=0), axis=0)  # row by row, from right to left
    slots, counts = np.unique(slot[0], return_counts=True)
    assert slots.size == drones
    np.testing.assert_allclose(counts / DRAWS, 1 / drones, atol=5 * np.sqrt(1 / drones / DRAWS))
    for row in range(rows.max() + 1):
        assert ((rows == row).sum(axis=0) == min(LANES, drones - row * LANES)).all()


def test_every_gate_is_drawn_and_a_chosen_one_is_kept() -> None:
    track = TRACKS["figure-eight"]
    _, counts = np.unique(draw(track, 2).gate, return_counts=True)
    np.testing.assert_allclose(counts / DRAWS, 1 / 6, atol=0.05)
    course, key = make_course(track), jax.random.key(1)
    for gate in (0, 4):
        start = jax.jit(lambda c, k, gate=gate: start_grid(c, k, 2, (30,), gate))(course, key)
        np.testing.assert_array_equal(start.gate, gate)
        forward, _, _ = in_gate_frame(track, Start(*(np.asarray(part) for part in start)))
        assert ((forward < -1.3) & (forward > -3.2)).all()


def test_starts_vary_and_repeat_with_their_key() -> None:
    one, again, other = (draw(TRACKS["ring"], 4, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one.position_w, again.position_w)
    assert (one.position_w != other.position_w).mean() > 0.99
    back = -in_gate_frame(TRACKS["ring"], one)[0].mean(axis=0)
    assert back.min() < 1.6
    assert back.max() > 2.9


def test_one_race_needs_no_batch_axis() -> None:
    start = jax.jit(lambda course, key: start_grid(course, key, 3))(make_course(TRACKS["ring"]), jax.random.key(0))
    assert start.position_w.shape == (3, 3)
    assert start.heading.shape == (3,)
    assert start.gate.shape == ()
