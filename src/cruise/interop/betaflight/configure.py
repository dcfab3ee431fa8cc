"""Settings become a folder that the firmware starts in: told by its command line once, kept, and used again."""

import hashlib
import json
import os
import re
import shutil
import socket
import tempfile
from pathlib import Path
from typing import NamedTuple

from cruise.errors import CruiseError
from cruise.interop.betaflight.firmware import cache_folder, find_firmware, find_shim
from cruise.interop.betaflight.process import Process

PROMPT = b"\n# "
BOOT = 3.0  # before it listens [s]
PATIENCE = 5.0  # for an answer, of the firmware's own time [s]
EEPROM = "eeprom.bin"
EEPROM_SIZE = 32768
ASKED = ("motor_idle", "min_check", "p_yaw", "i_yaw", "iterm_windup", "pidsum_limit_yaw")  # what the link must know


class Configured(NamedTuple):
    """A firmware as it was set."""

    folder: Path
    known: dict[str, float]  # settings that the link must know, in the firmware's units
    refused: tuple[str, ...]  # lines that mean nothing to it


def configured(lines: tuple[str, ...]) -> Configured:
    """The folder in which the firmware has these settings.

    Raises:
        CruiseError: the firmware is missing, does not start, or does not keep them.
    """
    program = find_firmware()
    made = program.stat()
    key = json.dumps([ASKED, str(program), made.st_size, made.st_mtime_ns, find_shim().name, lines])
    folder = cache_folder() / f"settings-{hashlib.sha256(key.encode()).hexdigest()[:16]}"
    if not (folder / EEPROM).is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=folder.parent))
        try:
            (fresh / "told.json").write_text(json.dumps(_tell(fresh, lines)))
            if (fresh / EEPROM).stat().st_size != EEPROM_SIZE:
                raise CruiseError(f"betaflight could not keep its settings in {folder.parent}: is the disk full?")
            _put(fresh, folder)
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
    told = json.loads((folder / "told.json").read_text())
    return Configured(folder, told["known"], tuple(told["refused"]))


def _put(fresh: Path, folder: Path) -> None:
    """Whole or not at all; where another process was sooner, its folder is as good."""
    try:
        os.rename(fresh, folder)
    except OSError:
        if not (folder / EEPROM).is_file():
            raise


class CommandLine:
    """The firmware's command line, over its first port; its time goes on only while it is asked."""

    def __init__(self, process: Process) -> None:
        """Wait until it listens, and enter."""
        self._process = process
        for _ in range(round(BOOT / 1e-2)):
            process.run(1e-2)
        self._link = socket.create_connection(("127.0.0.1", process.port))
        self._link.setblocking(False)
        self._ask(b"#")

    def tell(self, line: str) -> str:
        """What it answers to a line."""
        return self._ask(line.encode("ascii") + b"\r\n").removeprefix(line)

    def save(self) -> None:
        """Keep the settings: the firmware ends with that."""
        self._link.sendall(b"save\r\n")
        try:
            for _ in range(round(PATIENCE / 1e-3)):
                self._process.run()
        except CruiseError:
            return
        raise CruiseError("the firmware betaflight did not save its settings")

    def close(self) -> None:
        """Leave."""
        self._link.close()

    def _ask(self, data: bytes) -> str:
        self._link.sendall(data)
        got = b""
        for _ in range(round(PATIENCE / 1e-3)):
            self._process.run()
            try:
                got += self._link.recv(65536)
            except BlockingIOError:
                continue
            if got.endswith(PROMPT):
                return got.decode("ascii", "replace")
        raise CruiseError(f"the command line of the firmware betaflight did not answer {data!r}")


def _tell(folder: Path, lines: tuple[str, ...]) -> dict[str, object]:
    """Tell all lines, and ask what the link must know."""
    process = Process.start(folder, uart=True)
    try:
        console = CommandLine(process)
        try:
            refused = [line for line in lines if "###ERROR" in console.tell(line)]
            known = {name: _number(console.tell(f"get {name}"), name) for name in ASKED}
            console.save()
        finally:
            console.close()
    finally:
        process.close()
    return {"known": known, "refused": refused}


def _number(answer: str, name: str) -> float:
    found = re.search(rf"{name} = (\d+)", answer)
    if found is None:
        raise CruiseError(f"the firmware betaflight does not say its {name}")
    return float(found.group(1))
