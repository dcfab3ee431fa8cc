"""The centre line is closed, passes every gate along its normal, and measures progress where a drone is."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Gate, Track
from cruise.geometry import beyond_opening, heading_of, tilt_of, to_gate
from cruise.pilots.se_ibr.centre_line import HALF_CORRIDOR, frame_at, make_centre_line, project, start_progress
from cruise.presets import TRACKS
from cruise.racing.track_file import load_track
from cruise.racing.ways import SHARPEST, TURN_RADIUS, bent_least, turning_way
from tests.helpers import random_track
from tests.racing.obstacles import distance, pole_in_the_way, wall_in_the_way, with_solids

FAR = {"bounds_low": (-40.0, -40.0, 0.0), "bounds_high": (40.0, 40.0, 30.0)}
STACKED = (
    Gate((0, 0, 2), 0.0),
    Gate((0, 0, 5), np.pi),
    Gate((8, 0, 5), 0.0),
    Gate((8, 0, 12), 0.0),
)
ALL = {
    **TRACKS,
    "shuttle": load_track("examples/tracks/shuttle.toml"),
    "slalom": load_track("examples/tracks/slalom.toml"),
    "random": random_track(1),
    "one gate": Track("one", (Gate((0, 0, 2), 0.5),), **FAR),
    "stacked": Track("stacked", STACKED, **FAR),
}


@pytest.mark.parametrize("name", ALL)
def test_closed_even_and_of_its_length(name):
    line = make_centre_line(ALL[name])
    step = np.linalg.norm(np.roll(line.point_w, -1, axis=1) - line.point_w, axis=0)
    np.testing.assert_allclose(step, line.spacing, rtol=2e-3)  # the last step closes the curve
    assert step.sum(dtype=np.float64) == pytest.approx(line.length, rel=1e-3)
    along = (np.roll(line.point_w, -1, axis=1) - np.roll(line.point_w, 1, axis=1)) / (2 * line.spacing)
    np.testing.assert_allclose(along, line.tangent_w, atol=0.05)


@pytest.mark.parametrize("name", ALL)
def test_passes_every_gate_along_its_normal(name):
    track = ALL[name]
    line = make_centre_line(track)
    assert (np.diff(line.gate_progress) > 0).all()
    at = frame_at(line, jnp.asarray(line.gate_progress))
    for gate, point, tangent, half in zip(track.gates, at.point_w.T, at.tangent_w.T, at.half.T, strict=True):
        np.testing.assert_allclose(point, gate.position_w, atol=line.spacing)
        np.testing.assert_allclose(tangent, [np.cos(gate.yaw), np.sin(gate.yaw), 0.0], atol=0.02)
        np.testing.assert_allclose(half, [gate.width / 2, gate.height / 2], atol=1e-3)
    assert line.half.max() <= max(HALF_CORRIDOR, *(max(gate.width, gate.height) / 2 for gate in track.gates))


@pytest.mark.parametrize("name", ALL)
def test_frames_are_right_handed_and_upright(name):
    line = make_centre_line(ALL[name])
    axes = np.stack([line.tangent_w, line.left_w, line.up_w])
    products = np.einsum("icm,jcm->mij", axes, axes)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-5)
    np.testing.assert_allclose(np.cross(line.tangent_w, line.left_w, axis=0), line.up_w, atol=1e-5)
    assert np.abs(line.left_w[2]).max() == 0.0
    assert line.up_w[2].min() > 0.5


def test_length_of_a_circle():
    """Gates on a level circle: the curve is the circle, 3 cm off at most."""
    angles = 2 * np.pi * np.arange(6) / 6
    gates = tuple(Gate((7 * np.cos(a), 7 * np.sin(a), 2.0), a + np.pi / 2) for a in angles)
    line = make_centre_line(Track("circle", gates, **FAR))
    assert line.length == pytest.approx(2 * np.pi * 7, rel=2e-3)
    np.testing.assert_allclose(np.hypot(*line.point_w[:2]), 7.0, atol=0.03)
    np.testing.assert_allclose(line.curvature, 1 / 7, rtol=0.1)


@pytest.mark.parametrize("heading", [0.0, 0.7, 2.0, np.pi, -1.3])
@pytest.mark.parametrize("place", [(16.0, 0.0), (-9.0, 4.0), (0.5, -0.5), (0.0, 0.0)])
def test_arcs_and_straight_lead_where_they_should(place, heading):
    a, b = Gate((0.0, 0.0, 2.0), 0.3), Gate((*place, 6.0), heading)
    way = turning_way(a, b, TURN_RADIUS)
    np.testing.assert_allclose(way.point_w[[0, -1]], [a.position_w, b.position_w], atol=1e-6)
    headings = np.arctan2(way.tangent_w[[0, -1], 1], way.tangent_w[[0, -1], 0])
    np.testing.assert_allclose(np.exp(1j * headings), np.exp(1j * np.array([a.yaw, b.yaw])), atol=1e-6)
    assert way.curvature.max() < 1.05 / TURN_RADIUS
    level = np.linalg.norm(way.tangent_w[:, :2], axis=1)
    assert np.abs(way.tangent_w[:, 2] / level).max() <= 1.0 + 1e-6


def test_a_hairpin_is_no_spline():
    """To and fro along one line a spline would turn on the spot; a gentle bend is one."""
    assert bent_least(Gate((-8, 0, 2), np.pi), Gate((8, 0, 2), 0.0)) is None
    assert bent_least(Gate((0, 0, 2), 0.0), Gate((0, 0, 9), 0.0)) is None
    bend = bent_least(Gate((0, 0, 2), 0.0), Gate((8, 8, 3), np.pi / 2))
    assert bend is not None
    assert bend.curvature.max() < SHARPEST


@pytest.mark.parametrize("name", ["ring", "figure-eight", "slalom", "random"])
def test_projection_against_brute_force(name):
    line = make_centre_line(ALL[name])
    rng = np.random.default_rng(3)
    true = rng.uniform(0, line.length, 200)
    frame = frame_at(line, jnp.asarray(true))
    away = rng.uniform(-1, 1, (2, 200))
    position = np.asarray(frame.point_w + away[0] * frame.left_w + away[1] * frame.up_w, np.float64)
    found = np.asarray(jax.jit(lambda p, s: project(line, p, s))(position, true + rng.uniform(-1.0, 1.0, 200)))

    fine = np.linspace(-2.0, 2.0, 4001)
    for p, s0, s in zip(position.T, true, found, strict=True):
        candidates = (s0 + fine) % line.length
        curve = np.stack([np.interp(candidates, _extended(line)[0], row) for row in _extended(line)[1]])
        nearest = s0 + fine[np.linalg.norm(curve - p[:, None], axis=0).argmin()]
        assert s == pytest.approx(nearest, abs=0.06)


def _extended(line):
    """The table with its first sample repeated at the end, so that interpolation closes it."""
    progress = np.arange(line.point_w.shape[1] + 1) * line.spacing
    return progress, np.concatenate([line.point_w, line.point_w[:, :1]], axis=1).astype(np.float64)


def test_projection_counts_laps_and_keeps_to_its_branch_at_the_crossing():
    """Flying the figure-eight through the crossing, off the line by up to 0.8 m, no other branch takes over."""
    line = make_centre_line(TRACKS["figure-eight"])
    step = jax.jit(lambda p, s: project(line, p, s))
    offsets = np.array([-0.8, -0.3, 0.0, 0.3, 0.8])
    progress = jnp.zeros(5)
    for true in np.arange(0.0, 2 * line.length, 0.4):
        frame = frame_at(line, jnp.full(5, true))
        progress = step(frame.point_w + offsets * frame.left_w, progress)
        np.testing.assert_allclose(progress, true, atol=0.1)
    crossing = line.point_w[:2]
    assert np.linalg.norm(crossing, axis=0).min() < 0.1  # the test flew through it


@pytest.mark.parametrize("name", ["figure-eight", "shuttle"])
def test_start_progress_lies_on_the_way_to_the_gate(name):
    track = ALL[name]
    line = make_centre_line(track)
    gates = jnp.arange(len(track.gates)).repeat(3)
    back = jnp.tile(jnp.array([0.2, 2.0, 6.0]), len(track.gates))
    true = jnp.asarray(line.gate_progress)[gates] - back
    frame = frame_at(line, true)
    found = jax.jit(lambda p, g: start_progress(line, p, g))(frame.point_w + 0.7 * frame.left_w, gates)
    np.testing.assert_allclose(found, true, atol=0.1)


TILTED = (
    Gate((8, 0, 3), np.pi / 2, roll=0.4),
    Gate((0, 8, 5), np.pi, pitch=np.pi / 2, shape="round", width=2.5),
    Gate((-8, 0, 2), -np.pi / 2, width=3.0, roll=-1.0),
    Gate((0, -8, 3), 0.0, pitch=-0.9, roll=-0.3),
)


def test_tilted_gates_are_crossed_along_their_normals_within_their_openings():
    track = Track("tilted", TILTED, **FAR)
    line = make_centre_line(track)
    axes = np.stack([line.tangent_w, line.left_w, line.up_w])
    products = np.einsum("icm,jcm->mij", axes, axes)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-5)
    at = frame_at(line, jnp.asarray(line.gate_progress))
    for k, gate in enumerate(TILTED):
        normal = np.array(
            [np.cos(gate.yaw) * np.cos(gate.pitch), np.sin(gate.yaw) * np.cos(gate.pitch), -np.sin(gate.pitch)]
        )
        np.testing.assert_allclose(at.tangent_w[:, k], normal, atol=0.03)
        for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
            corner = a * at.half[0, k] * at.left_w[:, k] + b * at.half[1, k] * at.up_w[:, k]
            _, left, up = to_gate(heading_of(gate.yaw), tuple(np.asarray(corner)), tilt_of(gate.roll, gate.pitch))
            half = (gate.width / 2, (gate.width if gate.shape == "round" else gate.height) / 2)
            assert beyond_opening(left, up, *half, True if gate.shape == "round" else None) < 0.03
        assert at.half[:, k].min() > 0.5


@pytest.mark.parametrize("solid", [pole_in_the_way(TRACKS["ring"], 0), wall_in_the_way(TRACKS["ring"], 0)])
def test_the_corridor_ends_at_solids(solid):
    line = make_centre_line(with_solids(TRACKS["ring"], solid))
    for a, b in itertools.product(np.linspace(-1, 1, 5), repeat=2):
        inside = line.point_w + 0.98 * (a * line.half[0] * line.left_w + b * line.half[1] * line.up_w)
        assert distance(solid, inside.T.astype(np.float64)).min() > 0
    assert line.half.min() > 0.5


def test_the_corridor_ends_at_the_box():
    """A hall whose wall is 1.2 m behind the gates."""
    ring = TRACKS["ring"]
    hall = dataclasses.replace(ring, bounds_low=(-11.2, -11.2, 0.0), bounds_high=(11.2, 11.2, 5.2))
    line = make_centre_line(hall)
    beyond = line.point_w[:2] + np.array([[[1.0]], [[-1.0]]]) * line.half[0] * line.left_w[:2]
    assert np.abs(beyond).max() <= 11.2 + 1e-3
    assert (line.point_w[2] + line.half[1] * line.up_w[2]).max() <= 5.2 + 1e-3
