"""A training run's whole state in one file, so that it is there or not; the one before is kept as a fallback."""

import json
import logging
import os
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from cruise.errors import CruiseError
from cruise.storage import tensors
from cruise.storage.atomic import write_atomically, writing
from cruise.storage.config_file import parse_json

CURRENT = "checkpoint.safetensors"
PREVIOUS = "checkpoint.previous.safetensors"
META = "cruise"  # key of the JSON in the file's metadata

Tree = TypeVar("Tree")
_LOG = logging.getLogger("cruise")


def save_checkpoint(folder: Path | str, tree: Any, meta: dict[str, Any]) -> None:
    """Write a pytree of arrays and a JSON object. At every moment one whole checkpoint is in `folder`.

    The newest is `checkpoint.safetensors`; the one before becomes `checkpoint.previous.safetensors`. PRNG keys are
    stored as their data.

    Raises:
        CruiseError: the folder cannot be written.
    """
    folder = Path(folder)
    arrays = {name: _plain(leaf) for name, leaf in _leaves(tree).items()}
    data = tensors.encode(arrays, {META: json.dumps(meta, allow_nan=False)})
    fresh = folder / f"{CURRENT}.new"
    write_atomically(fresh, data)
    with writing(folder / CURRENT):
        if (folder / CURRENT).exists():
            os.replace(folder / CURRENT, folder / PREVIOUS)
        os.replace(fresh, folder / CURRENT)


def load_checkpoint(folder: Path | str, like: Tree) -> tuple[Tree, dict[str, Any]]:
    """The newest checkpoint of `folder` that is whole, and its JSON object.

    Args:
        folder: where `save_checkpoint` wrote.
        like: a pytree of the same structure, shapes and dtypes (arrays or `jax.ShapeDtypeStruct`).

    Raises:
        CruiseError: there is no checkpoint, none is whole, or it does not fit `like`.
    """
    folder = Path(folder)
    present = [folder / name for name in (CURRENT, PREVIOUS) if (folder / name).is_file()]
    if not present:
        raise CruiseError(f"no checkpoint in {folder}: expected {CURRENT}")
    for path in present[:-1]:
        try:
            return _load(path, like)
        except CruiseError as error:
            fault = error
        try:
            found = _load(present[-1], like)
        except CruiseError:
            raise fault from None
        _LOG.warning("%s; going on from %s", fault, PREVIOUS)
        return found
    return _load(present[-1], like)


def load_meta(folder: Path | str) -> dict[str, Any]:
    """The JSON object of the newest checkpoint of `folder` that is whole; see `load_checkpoint`."""
    return load_checkpoint(folder, _ANYTHING)[1]


_ANYTHING = object()  # in place of a pytree: its arrays are not looked at


def _load(path: Path, like: Tree) -> tuple[Tree, dict[str, Any]]:
    where = f"checkpoint {path}"
    arrays, metadata = tensors.load(path, "checkpoint")
    if META not in metadata:
        raise CruiseError(f"{where}: has no {META!r} metadata; it was not written by this program")
    meta = parse_json(metadata[META], where)
    if not isinstance(meta, dict):
        raise CruiseError(f"{where}: metadata is not a JSON object")
    return (like if like is _ANYTHING else _rebuild(arrays, like, where)), meta


def _rebuild(arrays: dict[str, np.ndarray], like: Tree, where: str) -> Tree:
    wanted = _leaves(like)
    tensors.check_names(arrays, wanted, where)
    leaves = []
    for name, leaf in wanted.items():
        shape, dtype = _stored_form(leaf)
        tensors.check_array(name, arrays[name], shape, dtype, where)
        leaves.append(_restored(arrays[name], leaf))
    return jax.tree.unflatten(jax.tree.structure(like), leaves)


def _leaves(tree: Any) -> dict[str, Any]:
    return {jax.tree_util.keystr(path) or "root": leaf for path, leaf in jax.tree_util.tree_leaves_with_path(tree)}


def _is_key(leaf: Any) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _plain(leaf: Any) -> np.ndarray:
    return np.asarray(jax.random.key_data(leaf) if _is_key(leaf) else leaf)


def _stored_form(leaf: Any) -> tuple[tuple[int, ...], np.dtype]:
    if _is_key(leaf):
        data = jax.eval_shape(jax.random.key_data, leaf)
        return data.shape, np.dtype(data.dtype)
    return tuple(leaf.shape), np.dtype(leaf.dtype)


def _restored(array: np.ndarray, leaf: Any) -> Any:
    if _is_key(leaf):
        return jax.random.wrap_key_data(jnp.asarray(array), impl=_key_impl(leaf))
    return array if isinstance(leaf, np.ndarray | np.generic) else jnp.asarray(array)


def _key_impl(leaf: Any) -> Any:
    """Kind of generator of a PRNG key, of which perhaps only the shape is known."""
    found: list[Any] = []
    jax.eval_shape(lambda key: found.append(jax.random.key_impl(key)), leaf)
    return found[0]
