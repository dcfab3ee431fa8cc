"""Paths among the flags: an empty one is a mistake, not the working folder."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo


@contextlib.contextmanager
def refusing_empty_paths() -> Iterator[None]:
    """Within it the parser takes no empty word for a path."""
    registry = ConstructorRegistry()

    @registry.primitive_rule
    def _rule(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
        if info.type is not Path:
            return None
        return PrimitiveConstructorSpec(
            nargs=1,
            metavar="PATH",
            instance_from_str=lambda words: _path(words[0]),
            is_instance=lambda thing: isinstance(thing, Path),
            str_from_instance=lambda path: [str(path)],
        )

    with registry:
        yield


def _path(word: str) -> Path:
    if not word:
        raise ValueError("a path must not be empty")
    return Path(word)
