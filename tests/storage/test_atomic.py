"""Files appear whole or not at all, whatever happens to the writer."""

import os
import signal
import subprocess
import sys
import time

import pytest

from cruise import files
from cruise.errors import CruiseError
from cruise.storage.atomic import read_bytes, write_atomically

WRITER = """
import sys
from cruise.storage.atomic import write_atomically
a, b = b"a" * 3_000_000, b"b" * 3_000_000
write_atomically(sys.argv[1], a)
print("ready", flush=True)
while True:
    write_atomically(sys.argv[1], b)
    write_atomically(sys.argv[1], a)
"""


def test_writes_into_a_new_folder(tmp_path):
    path = tmp_path / "a" / "b.bin"
    write_atomically(path, b"one")
    write_atomically(path, b"two")
    assert path.read_bytes() == b"two"
    assert os.listdir(path.parent) == ["b.bin"]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_failure_leaves_the_old_content_and_nothing_else(step, tmp_path, monkeypatch):
    path = tmp_path / "file"
    path.write_bytes(b"old")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, step, fail)
    with pytest.raises(CruiseError, match=rf"cannot write .*{path.name}: No space left on device"):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["file"]


def test_killed_writer_leaves_a_whole_file(tmp_path):
    path = tmp_path / "file"
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"ready\n"
    for _ in range(20):
        time.sleep(0.01)
        assert set(path.read_bytes()) in ({ord("a")}, {ord("b")})
    process.send_signal(signal.SIGKILL)
    process.wait()
    content = path.read_bytes()
    assert len(content) == 3_000_000
    assert content in (b"a" * len(content), b"b" * len(content))


def test_unwritable_and_unreadable_places_give_one_line(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    for action in (
        lambda: write_atomically(tmp_path / "file" / "below", b""),
        lambda: write_atomically(tmp_path, b""),
        lambda: write_atomically("nul\0byte", b""),
        lambda: read_bytes(tmp_path, "thing"),
        lambda: read_bytes(tmp_path / "none", "thing"),
        lambda: read_bytes("nul\0byte", "thing"),
    ):
        with pytest.raises(CruiseError) as error:
            action()
        assert "\n" not in str(error.value)
