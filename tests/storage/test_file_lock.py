"""A held file keeps other processes out until its process lets go of it or dies."""

import contextlib
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from cruise.errors import CruiseError
from cruise.storage import file_lock
from cruise.storage.file_lock import Busy, hold, locked, release

HOLDS = """
import fcntl, sys, time
file = open(sys.argv[1], "a")
fcntl.flock(file, fcntl.LOCK_EX)
print(1, flush=True)
time.sleep(600)
"""


@contextlib.contextmanager
def held_elsewhere(path: Path) -> Iterator[subprocess.Popen]:
    """Another process holds the file."""
    with subprocess.Popen([sys.executable, "-c", HOLDS, str(path)], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"1\n"
        try:
            yield process
        finally:
            process.kill()


def free(path: Path) -> bool:
    """Whether somebody else could hold it."""
    try:
        with locked(path):
            return True
    except Busy:
        return False


def test_another_process_keeps_it_until_it_dies(tmp_path):
    path = tmp_path / "lock"
    with held_elsewhere(path) as process:
        for _ in range(2):
            with pytest.raises(Busy):
                hold(path)
        process.kill()
        process.wait()
        hold(path)
    assert not free(path)
    release(path)
    release(path)
    assert free(path)


def test_a_process_may_hold_it_again_and_by_another_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hold(tmp_path / "lock")
    hold(Path("lock"))
    assert not free(tmp_path / "lock")
    release(Path("lock"))
    assert free(tmp_path / "lock")


def test_a_folder_made_anew_is_held_anew(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    hold(folder / "lock")
    shutil.rmtree(folder)
    folder.mkdir()
    hold(folder / "lock")
    assert not free(folder / "lock")
    release(folder / "lock")


def test_where_nothing_can_be_locked_or_written(tmp_path, monkeypatch, caplog):
    with pytest.raises(CruiseError, match=r"cannot write .*none/lock: No such file or directory"):
        hold(tmp_path / "none" / "lock")

    def no_locks(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(file_lock.fcntl, "flock", no_locks)
    hold(tmp_path / "lock")
    assert "cannot be locked (Operation not supported)" in caplog.text
    release(tmp_path / "lock")
