"""A track as arrays."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Track
from cruise.env.ranks import ranks
from cruise.presets import PAPER_TRACKS, TRACKS
from cruise.racing.contacts import out_of_bounds
from cruise.racing.course import UNROLLED, make_course, pick, target_opening
from cruise.racing.field import UNROLLED as DRONES
from cruise.racing.field import all_opponents, opponent, opponents, over_opponents
from cruise.racing.gates import cross_gates
from tests.helpers import random_track

ALL_TRACKS = [*TRACKS.values(), random_track(5), random_track(6, gates=1)]


@pytest.mark.parametrize("track", ALL_TRACKS, ids=lambda t: f"{t.name}-{len(t.gates)}")
def test_arrays_are_the_tracks_numbers(track: Track) -> None:
    course = make_course(track)
    assert course.num_gates == len(track.gates)
    for g, gate in enumerate(track.gates):
        np.testing.assert_allclose(course.position_w[:, g], gate.position_w, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(course.normal_w[:, g], [np.cos(gate.yaw), np.sin(gate.yaw)], atol=1e-6)
        np.testing.assert_allclose(course.half_size[:, g], [gate.width / 2, gate.height / 2], rtol=1e-6)
    np.testing.assert_allclose(course.bounds_low, track.bounds_low)
    np.testing.assert_allclose(course.bounds_high, track.bounds_high)
    assert all(leaf.dtype == jnp.float32 for leaf in jax.tree.leaves(course))


@pytest.mark.parametrize("gates", [7, UNROLLED + 3])
@pytest.mark.parametrize("shape", [(), (4,), (4, 6)])
def test_pick_is_indexing(shape: tuple[int, ...], gates: int) -> None:
    course = make_course(random_track(5, gates))
    gate = np.random.default_rng(0).integers(course.num_gates, size=shape)
    for table in (course.position_w, course.normal_w, course.half_size):
        np.testing.assert_array_equal(pick(table, jnp.asarray(gate)), np.asarray(table)[:, gate])


@pytest.mark.parametrize("gates", [7, UNROLLED + 3])
def test_pick_where_races_have_gates_of_their_own(gates: int) -> None:
    rng = np.random.default_rng(1)
    table, gate = rng.normal(size=(3, gates, 6)).astype(np.float32), rng.integers(gates, size=(4, 6))
    expected = table[:, gate, np.arange(6)]
    np.testing.assert_array_equal(pick(jnp.asarray(table), jnp.asarray(gate)), expected)


def equations(jaxpr: object) -> int:
    """Of a program, those of its loops' bodies among them."""
    inner = [
        part for eqn in jaxpr.eqns for part in jax.tree.leaves(list(eqn.params.values())) if hasattr(part, "jaxpr")
    ]
    return len(jaxpr.eqns) + sum(equations(part.jaxpr) for part in inner)


def test_what_is_traced_does_not_grow_with_the_track() -> None:
    def size(gates: int) -> int:
        course = make_course(random_track(5, gates))

        def step(start: jax.Array, end: jax.Array, gate: jax.Array) -> tuple:
            target = target_opening(course, gate)
            return cross_gates(course, start, end, gate, 0.0), out_of_bounds(course, end), target

        place = jnp.zeros((3, 4, 2))
        return equations(jax.make_jaxpr(step)(place, place, jnp.zeros((4, 2), int)).jaxpr)

    assert size(200) == size(UNROLLED + 1) < size(UNROLLED)


def test_many_opponents_are_met_as_few_are() -> None:
    """A scan over them gives what the loop written out gives, in the same order."""
    rng = np.random.default_rng(2)
    values = jnp.asarray(rng.normal(size=(2, DRONES + 3, 5)).astype(np.float32))

    def visit(total: jax.Array, k: jax.Array | int, theirs: jax.Array) -> jax.Array:
        return 0.5 * total + k * theirs

    found = over_opponents(visit, jnp.zeros_like(values), (values, 1))
    expected = jnp.zeros_like(values)
    for k in opponents(DRONES + 3):
        expected = visit(expected, k, opponent(values, k, 1))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    stacked = jnp.stack([opponent(values, k, 1) for k in opponents(DRONES + 3)], axis=1)
    np.testing.assert_array_equal(all_opponents(values, 1), stacked)


@pytest.mark.parametrize("count", [5, DRONES + 3])
def test_ranks_are_places_in_a_stable_sort(count: int) -> None:
    values = np.random.default_rng(3).integers(0, 6, size=(count, 40)).astype(np.float32)
    expected = np.argsort(np.argsort(values, axis=0, kind="stable"), axis=0)
    np.testing.assert_array_equal(np.stack(ranks([jnp.asarray(v) for v in values])), expected)


def test_the_papers_tracks() -> None:
    """Gates, lengths and heights of the paper's two tracks."""
    lengths = {}
    for name, track in PAPER_TRACKS.items():
        gates = np.array([g.position_w for g in track.gates])
        lengths[name] = np.linalg.norm(np.roll(gates, -1, axis=0) - gates, axis=1).sum()
        assert all(g.width == g.height == 2.0 for g in track.gates)
    assert lengths["ring"] == pytest.approx(58.95, abs=0.01)
    assert lengths["figure-eight"] == pytest.approx(56.8, abs=0.05)
    ring, eight = TRACKS["ring"], TRACKS["figure-eight"]
    assert [g.position_w[2] for g in ring.gates] == [4, 3, 4, 3, 4]
    np.testing.assert_allclose([np.hypot(*g.position_w[:2]) for g in ring.gates], 10)
    yaws = np.array([0, np.pi / 2, np.pi, np.pi, np.pi / 2, 0])
    np.testing.assert_allclose([g.yaw for g in eight.gates], yaws)


@pytest.mark.parametrize("track", PAPER_TRACKS.values(), ids=lambda t: t.name)
def test_built_in_gates_face_the_direction_of_flight(track: Track) -> None:
    """Each normal points along the segment that arrives and the one that leaves."""
    gates = np.array([g.position_w for g in track.gates])
    for g, gate in enumerate(track.gates):
        normal = np.array([np.cos(gate.yaw), np.sin(gate.yaw)])
        arriving, leaving = gates[g] - gates[g - 1], gates[(g + 1) % len(gates)] - gates[g]
        assert normal @ arriving[:2] > 0
        assert normal @ leaving[:2] > 0


@pytest.mark.parametrize("drones", [1, 2, 5])
def test_every_drone_meets_every_opponent_once(drones: int) -> None:
    ids = jnp.arange(drones)
    met = np.array([opponent(ids, k, 0) for k in opponents(drones)]).reshape(-1, drones)
    for drone in range(drones):
        assert sorted(met[:, drone]) == [d for d in range(drones) if d != drone]
