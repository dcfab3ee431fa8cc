"""Training on several devices at once: every device flies its share of the races, all hold the same parameters."""

import os
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jax.flatten_util import ravel_pytree
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from cruise.errors import CruiseError
from cruise.training.types import OpponentPool, TrainState

AXIS = "races"  # of the mesh
LEAST_LEARNERS = 64  # fewer drones that learn per processor core cost more in messages than they save


def mean_over_devices(tree: Any, axis: str | None) -> Any:
    """The mean of every leaf over the devices of a mesh axis, in one message; without an axis the leaves themselves."""
    if axis is None:
        return tree
    vector, unflatten = ravel_pytree(tree)
    return unflatten(jax.lax.pmean(vector, axis))


def use_cores(cores: int | None = None) -> None:
    """Let every core of the processor, or so many, be a device of its own, if JAX has not started yet.

    A core that steps its own races and learns from them waits for the others only when gradients are averaged; cores
    that share every loop of one device wait for each other at every loop.
    """
    here = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        jax.config.update("jax_num_cpu_devices", cores or here)
    except RuntimeError:  # it has: what devices there are will do
        return


def choose_devices(races: int, count: int | None = None, learners: int = 1) -> list[jax.Device]:
    """The first `count` devices; by default as many as share `races`, on a processor with enough of them each.

    In each race so many drones learn.

    Raises:
        CruiseError: there are not so many, or they cannot share the races equally.
    """
    devices = jax.devices()
    if jax.process_count() > 1:
        count = len(devices) if count is None else count
        if count != len(devices):
            raise CruiseError(f"several processes train on all of their {len(devices)} devices: leave out --devices")
    if count is not None:
        if not 1 <= count <= len(devices):
            raise CruiseError(f"devices must be from 1 to {len(devices)}, which JAX finds here, got {count}")
        if races % count:
            raise CruiseError(f"{count} devices cannot share {races} races equally")
        return devices[:count]
    least = -(-LEAST_LEARNERS // learners) if devices[0].platform == "cpu" else 1
    return devices[: shares(len(devices), races, least)]


def shares(most: int, races: int, least: int) -> int:
    """The largest number of equal shares up to `most` that leaves each at least `least` races."""
    return max(n for n in range(1, most + 1) if n == 1 or (races % n == 0 and races >= n * least))


def make_mesh(devices: Sequence[jax.Device]) -> Mesh:
    """A mesh of one axis."""
    return Mesh(np.array(devices), (AXIS,))


def over_races(tree: Any) -> Any:
    """Partition specs of arrays whose last axis is the races."""
    return jax.tree.map(lambda leaf: PartitionSpec(*[None] * (leaf.ndim - 1), AXIS), tree)


def state_specs(shape: TrainState) -> TrainState:
    """How a training state lies on the mesh: races and what belongs to them spread, everything else on every device."""
    everywhere = PartitionSpec()
    pool = OpponentPool(everywhere, everywhere, PartitionSpec(AXIS), everywhere)  # type: ignore[arg-type]
    return TrainState(
        model=everywhere,  # type: ignore[arg-type]
        optimiser=everywhere,
        opponents=pool,
        sparring=over_races(shape.sparring),
        races=over_races(shape.races),
        restart=PartitionSpec(AXIS),  # type: ignore[arg-type]
        key=everywhere,  # type: ignore[arg-type]
        updates=everywhere,  # type: ignore[arg-type]
        league=None if shape.league is None else everywhere,  # type: ignore[arg-type]
        carries=over_races(shape.carries),
        opponents_carry=over_races(shape.opponents_carry),
        average=None if shape.average is None else everywhere,  # type: ignore[arg-type]
    )


def shardings(mesh: Mesh, specs: Any) -> Any:
    """Where the leaves of a tree of partition specs lie."""
    is_spec = lambda leaf: isinstance(leaf, PartitionSpec)  # noqa: E731
    return jax.tree.map(lambda spec: NamedSharding(mesh, spec), specs, is_leaf=is_spec)
