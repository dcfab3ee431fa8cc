"""The start grid: laws over thousands of draws, for 1 to 16 drones on three tracks."""

import functools

import jax
import numpy as np
import pytest

from cruise.config import Track
from cruise.presets import PAPER_TRACKS
from cruise.racing.course import make_course
from cruise.racing.grid import MIN_HEIGHT, Start, start_grid
from cruise.racing.start_room import USUAL
from tests.helpers import random_track

ALL_TRACKS = [*PAPER_TRACKS.values(), random_track(7)]
# Grids know gates alone, so one long row of all tracks' gates is drawn from at once.
GATES = [(track, gate) for track in ALL_TRACKS for gate in track.gates]
COURSE = make_course(Track("all", tuple(gate for _, gate in GATES), (-30.0, -30.0, 0.0), (30.0, 30.0, 20.0)))
CENTRES, YAWS = np.array([g.position_w for _, g in GATES]), np.array([g.yaw for _, g in GATES])
DRAWS = 6000


@functools.cache
def _starter(drones: int) -> object:
    return jax.jit(lambda key: start_grid(COURSE, key, drones, (DRAWS,)))


@functools.cache
def draw(drones: int, seed: int = 0) -> Start:
    """DRAWS grids: position_w [3, N, DRAWS], heading [N, DRAWS], gate [DRAWS]."""
    return Start(*(np.asarray(part) for part in _starter(drones)(jax.random.key(seed))))


def in_gate_frame(start: Start) -> tuple[np.ndarray, np.ndarray]:
    """Forward and left of the gate, [N, DRAWS] each."""
    yaw, (x, y, _) = YAWS[start.gate], start.position_w - CENTRES[start.gate].T[:, None]
    return np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x


@pytest.mark.parametrize("drones", range(2, 17))
def test_no_two_drones_start_closer_than_a_metre(drones: int) -> None:
    p = draw(drones).position_w
    assert p.shape == (3, drones, DRAWS)
    for i in range(drones):
        for j in range(i):
            assert np.linalg.norm(p[:, i] - p[:, j], axis=0).min() > 1.0


@pytest.mark.parametrize("drones", range(1, 17))
def test_starts_upstream_of_the_gate_and_above_ground(drones: int) -> None:
    start = draw(drones)
    forward, left = in_gate_frame(start)
    assert forward.max() < -1.3
    assert forward.min() > -8.0
    assert np.abs(left).max() < 2.0
    assert start.position_w[2].min() >= MIN_HEIGHT
    np.testing.assert_allclose(np.cos(start.heading - YAWS[start.gate]), 1, atol=1e-6)


@pytest.mark.parametrize("drones", [1, 4, 16])
@pytest.mark.parametrize("track", ALL_TRACKS, ids=lambda t: t.name)
def test_starts_within_the_limits_of_the_track(track: Track, drones: int) -> None:
    start = draw(drones)
    mine = np.array([t is track for t, _ in GATES])[start.gate]
    p = start.position_w[:, :, mine]
    assert mine.sum() > 1000
    assert (p.max(axis=(1, 2)) < track.bounds_high).all()
    assert (p.min(axis=(1, 2)) > track.bounds_low).all()
    to_gate = np.linalg.norm(p - CENTRES[start.gate[mine]].T[:, None], axis=0)
    assert to_gate.max() < track.leave_distance


@pytest.mark.parametrize("drones", [1, 2, 4, 6, 16])
def test_every_drone_reaches_every_slot_equally(drones: int) -> None:
    """Slots by row and lane of drone 0, read from the drawn positions alone."""
    forward, left = in_gate_frame(draw(drones))
    rows = np.rint((forward.max(axis=0) - forward) / 1.5).astype(int)
    slot = np.argsort(np.argsort(left + 1000 * rows, axis=0), axis=0)  # row by row, from right to left
    slots, counts = np.unique(slot[0], return_counts=True)
    assert slots.size == drones
    np.testing.assert_allclose(counts / DRAWS, 1 / drones, atol=5 * np.sqrt(1 / drones / DRAWS))
    for row in range(rows.max() + 1):
        assert ((rows == row).sum(axis=0) == min(USUAL.lanes, drones - row * USUAL.lanes)).all()


def test_every_gate_is_drawn_equally() -> None:
    gates, counts = np.unique(draw(2).gate, return_counts=True)
    assert gates.size == len(GATES)
    np.testing.assert_allclose(counts / DRAWS, 1 / len(GATES), atol=0.02)


def test_a_chosen_gate_is_kept_and_one_race_needs_no_batch_axis() -> None:
    start = jax.jit(lambda key: start_grid(COURSE, key, 3, gate=7))(jax.random.key(0))
    assert start.position_w.shape == (3, 3)
    assert start.heading.shape == (3,)
    assert int(start.gate) == 7
    assert np.linalg.norm(np.asarray(start.position_w) - CENTRES[7][:, None], axis=0).max() < 4


def test_starts_vary_and_repeat_with_their_key() -> None:
    draw.cache_clear()
    one = draw(4)
    draw.cache_clear()
    again, other = draw(4), draw(4, seed=1)
    np.testing.assert_array_equal(one.position_w, again.position_w)
    assert (one.position_w != other.position_w).mean() > 0.99
    back = -in_gate_frame(one)[0].mean(axis=0)
    assert back.min() < 1.6
    assert back.max() > 2.9
