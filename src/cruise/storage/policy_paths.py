"""Where policies lie: those that are shipped, by their names; others by the path of a file or of a run's folder."""

import difflib
import os
from pathlib import Path

from cruise.errors import CruiseError

SHIPPED = Path(__file__).parent.parent / "policies"
IN_RUN = "policy"  # stem of the policy in the folder of a training run

StrPath = str | os.PathLike[str]


def find_policy(name_or_path: StrPath) -> Path:
    """Path, without ending, of a policy."""
    text = os.fspath(name_or_path)
    if not text or "\0" in text:
        raise CruiseError(f"policy {text!r}: neither a name nor a path")
    if isinstance(name_or_path, str) and os.sep not in text and with_ending(SHIPPED / text, ".json").is_file():
        return SHIPPED / text
    path = Path(text)
    if path.is_dir():
        return path / IN_RUN
    stem = stem_of(path)
    if any(with_ending(stem, ending).is_file() for ending in (".safetensors", ".json")):
        return stem
    raise CruiseError(_unknown(text, path))


def _unknown(text: str, path: Path) -> str:
    if path.suffix and path.suffix not in (".safetensors", ".json") and path.is_file():
        return f"policy {text}: expected a .safetensors or .json file"
    shipped = sorted(file.stem for file in SHIPPED.glob("*.json"))
    close = difflib.get_close_matches(text, shipped, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    names = ", ".join(shipped) or "none"
    return f"policy {text!r} not found: {hint}shipped: {names}; or give the path of a .safetensors file"


def stem_of(path: Path) -> Path:
    """A policy's path without the ending of one of its two files."""
    return path.with_suffix("") if path.suffix in (".safetensors", ".json") else path


def with_ending(stem: Path, ending: str) -> Path:
    """`stem` may hold dots of its own."""
    return stem.with_name(stem.name + ending)
