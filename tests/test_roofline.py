"""What the roofline counts, against counts by hand and XLA's own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import PartitionSpec

from benchmarks.flights import step_cost
from benchmarks.machine import Copy
from benchmarks.roofline import Ceiling, Cost, count, shares
from cruise.env.race_env import make_race_env
from cruise.pilots.named import NAMED
from cruise.presets import TRACKS, VEHICLES
from cruise.rollout import team_rules
from cruise.training.devices import AXIS, make_mesh

F32 = 4  # bytes


def counted(program, *arguments):
    return count(jax.jit(program).trace(*arguments).jaxpr)


def array(*shape):
    return jax.ShapeDtypeStruct(shape, jnp.float32)


def test_a_product_with_a_bias():
    """2 x 5 by 5 x 3: two operations per pair that meets, and one per sum with the bias."""
    cost = counted(lambda w, x, b: w @ x + b[:, None], array(2, 5), array(5, 3), array(2))
    assert cost == Cost(2 * 2 * 5 * 3 + 2 * 3, F32 * (2 * 5 + 5 * 3 + 2 * 3))


def test_a_loop_is_unrolled():
    """Ten rounds: a carry of 7 numbers in and out, a row of 7 in, a sum out; 7 products, 7 sums, a sum of 7."""

    def program(carry, rows):
        def step(carry, row):
            carry = carry * row + 1.0
            return carry, carry.sum()

        return jax.lax.scan(step, carry, rows)

    cost = counted(program, array(7), array(10, 7))
    assert cost == Cost(10 * 21, 10 * F32 * (7 + 7 + 7 + 1))


def test_what_all_rounds_share_does_not_move_but_what_they_read_of_it_does():
    def program(x, table):
        return jax.lax.fori_loop(0, 5, lambda k, x: x + jax.lax.dynamic_slice(table, (k,), (3,)), x)

    small, large = (counted(program, array(3), array(rows)) for rows in (10, 1000))
    assert small == large
    assert small.flop == 5 * 3
    assert small.bytes == 5 * (F32 * 2 * 3 + F32 * 2 * 3 + 2 * F32)  # slices, the carry, the number of the round


def test_of_a_condition_the_cheapest_branch_counts():
    cost = counted(lambda p, x: jax.lax.cond(p, lambda x: jnp.tanh(x * x), lambda x: -x, x), jnp.bool_(True), array(6))
    assert cost.flop == 6


def test_every_device_counts():
    devices = jax.devices()
    mesh, spread = make_mesh(devices), PartitionSpec(AXIS)
    program = jax.shard_map(lambda x: x * x, mesh=mesh, in_specs=spread, out_specs=spread)
    assert counted(program, array(4 * len(devices))).flop == 4 * len(devices)


def test_integers_and_choices_are_no_arithmetic():
    cost = counted(lambda k, x: jnp.where(x > 0, x, 0.0) + (k + k).astype(jnp.float32), jnp.int32(1), array(8))
    assert cost.flop == 8


def test_a_loop_without_a_known_end_cannot_be_counted():
    with pytest.raises(ValueError, match="not known beforehand"):
        counted(lambda x: jax.lax.while_loop(lambda x: x[0] < 1, lambda x: x + x, x), array(1))


def test_against_xlas_own_count():
    """Of a program without loops, choices and comparisons, which XLA counts as operations as well."""

    def program(w, x, y):
        h = jnp.tanh(w @ x + y[:, None])
        return (jnp.exp(-h) * h / (1.0 + h**2)).sum(axis=1), jnp.sqrt(y) - jnp.maximum(y, 0.5)

    arguments = array(16, 32), array(32, 64), array(16)
    xla = jax.jit(program).lower(*arguments).cost_analysis()
    # XLA counts a sum of n numbers as n - 1 operations, and every product of a power.
    assert counted(program, *arguments).flop == pytest.approx(xla["flops"] + xla["transcendentals"], rel=1e-3)


@pytest.mark.parametrize("pilot", ["chaser", "se-ibr"])
def test_a_step_of_a_race_costs_in_proportion_to_the_races(pilot):
    env = make_race_env(TRACKS["ring"], 2, VEHICLES["paper"])
    team = [NAMED[pilot]] * 2
    one, few, many = (step_cost(env, team, team_rules(team, 0.0, 0, (n,)), n) for n in (1, 8, 32))
    assert many.flop == pytest.approx(4 * few.flop, rel=0.01)
    assert 8 * one.flop >= few.flop > 1000
    assert many.bytes > few.bytes > 8 * 2 * F32 * 3


def test_shares_of_the_ceilings():
    told = shares(Cost(flop=10.0, bytes=4.0), per_second=5.0, ceiling=Ceiling(flop_per_s=100.0, bytes_per_s=80.0))
    assert told == {"flop": 10.0, "bytes": 4.0, "flop_share": 0.5, "copy_share": 0.25}


def test_copying_goes_over_the_whole_array():
    copy = Copy(4 * F32 * len(jax.devices()))
    assert copy.work == 2 * 4 * F32 * len(jax.devices())
    copy()
    np.testing.assert_array_equal(copy._array, -1.0)
    copy()
    np.testing.assert_array_equal(copy._array, 1.0)
