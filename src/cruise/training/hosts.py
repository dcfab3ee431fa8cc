"""Training in several processes, on one machine or many: who they are, and what they must agree on."""

import hashlib
import re
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils

from cruise.errors import CruiseError

T = TypeVar("T")
Tree = TypeVar("Tree")

SILENCE = 30  # of a process, after which it is lost; who stops waits as long for it [s]


def join(coordinator: str, process: str) -> None:
    """Meet the other processes of a run, before JAX is used for anything else.

    Args:
        coordinator: `host:port` at which the first process can be reached.
        process: `i/n`, this process's number from 0 and how many there are.

    Raises:
        CruiseError: an argument that cannot be meant, or the processes did not meet.
    """
    number, count = _numbers(process)
    if not re.fullmatch(r"[^:\s]+:\d{1,5}", coordinator):
        raise CruiseError(f"--coordinator must be host:port of the first process, got {coordinator!r}")
    try:
        jax.distributed.initialize(coordinator, count, number, heartbeat_timeout_seconds=SILENCE)
    except RuntimeError as error:
        reason = str(error).splitlines()[0]
        raise CruiseError(f"process {process} cannot meet the others at {coordinator}: {reason}") from None


def _numbers(process: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)/(\d+)", process)
    if not found or int(found[1]) >= int(found[2]):
        raise CruiseError(f"--process must be i/n, as 0/2 and 1/2 for two processes, got {process!r}")
    return int(found[1]), int(found[2])


def is_first() -> bool:
    """Whether this process is the one that writes files and speaks; without others it is."""
    return jax.process_index() == 0


def agreed(flag: bool) -> bool:
    """What the first process says, on all of them."""
    if jax.process_count() == 1:
        return flag
    return bool(multihost_utils.broadcast_one_to_all(np.asarray(flag)))


def on_first(action: Callable[[], T]) -> T | None:
    """What the first process gets from doing something that may fail; None on the others.

    Raises:
        CruiseError: it failed; on every process, so that none waits for the others.
    """
    result, fault = None, None
    if is_first():
        try:
            result = action()
        except CruiseError as error:
            fault = error
    if agreed(fault is not None):
        raise fault or CruiseError("the first process of this run could not go on, and says why")
    return result


def must_share(what: str, data: bytes) -> None:
    """Raises CruiseError where this process has other bytes than the first."""
    if jax.process_count() == 1:
        return
    mine = np.frombuffer(hashlib.sha256(data).digest(), np.uint8)
    if not np.array_equal(multihost_utils.broadcast_one_to_all(mine), mine):
        raise CruiseError(f"process {jax.process_index()} has another {what} than the first process of this run")


def whole(tree: Tree) -> Tree:
    """Arrays that are spread over processes, in full on each."""
    if jax.process_count() == 1:
        return tree
    return _restored(multihost_utils.process_allgather(_sendable(tree), tiled=True), tree)


def from_first(tree: Tree | None, like: Tree) -> Tree:
    """Arrays of the first process, on all; the others know only shapes and types, `like`."""
    if jax.process_count() == 1 and tree is not None:
        return tree
    mine = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), jax.eval_shape(_sendable, like))
    return _restored(multihost_utils.broadcast_one_to_all(mine if tree is None else _sendable(tree)), like)


def _is_key(leaf: Any) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _sendable(tree: Any) -> Any:
    """Random keys as the numbers they are."""
    return jax.tree.map(lambda leaf: jax.random.key_data(leaf) if _is_key(leaf) else leaf, tree)


def _restored(sent: Any, like: Tree) -> Tree:
    """Numbers as the keys they were."""
    restored: Tree = jax.tree.map(lambda leaf, x: jax.random.wrap_key_data(x) if _is_key(leaf) else x, like, sent)
    return restored
