"""Named arrays as safetensors: no code in the file, nothing executed when it is read."""

import json
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import safetensors
import safetensors.numpy

from cruise.errors import CruiseError, one_line
from cruise.storage.atomic import read_bytes


def encode(arrays: Mapping[str, np.ndarray], metadata: Mapping[str, str] | None = None) -> bytes:
    """Bytes of a safetensors file of booleans, integers and floats.

    The library takes an array's memory as it lies and reads it back in C order, so each is laid out in C order first.
    """
    for name, array in arrays.items():
        if array.dtype.kind not in "biuf":
            raise TypeError(f"array {name!r} is {array.dtype}; only booleans, integers and floats are stored")
    ordered = {name: np.array(array, order="C") for name, array in arrays.items()}
    return safetensors.numpy.save(ordered, metadata=dict(metadata or {}))


def decode(data: bytes, where: str) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Arrays and metadata. Raises CruiseError where `data` is not a whole safetensors file."""
    try:
        arrays = safetensors.numpy.load(data)
    except (safetensors.SafetensorError, KeyError, ValueError, TypeError) as error:
        raise CruiseError(f"{where}: not a whole safetensors file ({one_line(error)})") from None
    (length,) = struct.unpack("<Q", data[:8])
    return arrays, json.loads(data[8 : 8 + length]).get("__metadata__", {})


def load(path: Path | str, what: str) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Arrays and metadata of a file; `what` it is, for error messages."""
    return decode(read_bytes(path, what), f"{what} {path}")


def check_names(found: Mapping[str, object], wanted: Mapping[str, object], where: str) -> None:
    """Raises CruiseError unless both have the same keys."""
    for problem, names in (("lacks", wanted.keys() - found.keys()), ("has unknown", found.keys() - wanted.keys())):
        if names:
            more = f" and {len(names) - 1} more" if len(names) > 1 else ""
            raise CruiseError(f"{where}: {problem} array {min(names)!r}{more}")


def check_array(name: str, array: np.ndarray, shape: tuple[int, ...], dtype: np.dtype, where: str) -> None:
    """Raises CruiseError unless the array has this shape and dtype."""
    if array.shape != shape or array.dtype != dtype:
        raise CruiseError(
            f"{where}: array {name!r} is {array.dtype} {list(array.shape)}, expected {dtype} {list(shape)}"
        )
