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


def test_a_file_that_was_there_keeps_its_permissions_and_links_go_on_pointing(tmp_path):
    real, link, chain, dangling = (tmp_path / name for name in ("real", "link", "chain", "dangling"))
    real.write_bytes(b"old")
    real.chmod(0o640)
    link.symlink_to("real")
    chain.symlink_to(link)
    dangling.symlink_to("new")
    for path, content in ((real, b"one"), (link, b"two"), (chain, b"three")):
        write_atomically(path, content)
        assert real.read_bytes() == content
        assert real.stat().st_mode & 0o777 == 0o640
    write_atomically(dangling, b"four")
    assert (tmp_path / "new").read_bytes() == b"four"
    assert link.is_symlink()
    assert chain.is_symlink()
    assert dangling.is_symlink()
    assert sorted(os.listdir(tmp_path)) == ["chain", "dangling", "link", "new", "real"]


def test_pipes_and_devices_are_written_to(tmp_path):
    pipe, nowhere = tmp_path / "pipe", tmp_path / "nowhere"
    os.mkfifo(pipe)
    nowhere.symlink_to(os.devnull)
    content = bytes(range(256)) * 100  # less than the reader's own pipe holds
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        write_atomically(pipe, content)
        assert reader.communicate()[0] == content
    write_atomically(nowhere, content)
    assert sorted(os.listdir(tmp_path)) == ["nowhere", "pipe"]
    if os.path.exists("/dev/full"):
        (tmp_path / "full").symlink_to("/dev/full")
        with pytest.raises(CruiseError, match=r"cannot write .*full: No space left on device"):
            write_atomically(tmp_path / "full", content)


def test_the_longest_names_and_loops(tmp_path):
    write_atomically(tmp_path / ("x" * 255), b"1")
    write_atomically(tmp_path / ("é" * 127), b"1")
    assert len(os.listdir(tmp_path)) == 2
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(CruiseError, match="cannot write"):
        write_atomically(tmp_path / "loop", b"1")
