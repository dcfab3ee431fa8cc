"""What a command prints, and what is said where that cannot be written."""

import os
import subprocess
import sys

import pytest

from cruise import __version__
from cruise.cli import main as main_module
from cruise.cli.main import main

PYTHON_M = [sys.executable, "-m", "cruise"]


def shell(command: str, **variables: str) -> subprocess.CompletedProcess:
    """`CRUISE ...` in a shell of its own."""
    words = command.replace("CRUISE", f"{sys.executable} -m cruise")
    return subprocess.run(
        ["bash", "-c", words], check=False, capture_output=True, text=True, env={**os.environ, **variables}
    )


def test_python_runs_the_package_as_the_command():
    done = subprocess.run([*PYTHON_M, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"cruise {__version__}\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
@pytest.mark.parametrize("command", ["tracks list", "tracks show ring", "--help", "--version", "train --help"])
def test_a_full_disk_is_told_in_one_line(command):
    done = shell(f"CRUISE {command} > /dev/full")
    assert (done.returncode, done.stdout) == (74, "")
    assert done.stderr == "error: cannot read or write: No space left on device\n"


def test_closed_streams():
    """A closed output is told at once; closed errors change nothing; no file takes the place of a stream."""
    done = shell("CRUISE tracks list >&-")
    assert (done.returncode, done.stderr) == (74, "error: cannot write the output: standard output is closed\n")
    done = shell("CRUISE tracks show ring 2>&- <&-")
    assert done.returncode == 0
    assert "ring" in done.stdout
    done = shell("CRUISE nothing 2>&-")
    assert (done.returncode, done.stdout) == (2, "")
    done = shell("CRUISE nothing >&- 2>&-")
    assert (done.returncode, done.stdout) == (74, "")


def test_letters_that_the_encoding_lacks_are_escaped(tmp_path):
    track = tmp_path / "prix.toml"
    assert main(["tracks", "random", "--out", str(track)]) == 0
    track.write_text(track.read_text().replace('name = "random-0"', 'name = "Großer Preis €"'), encoding="utf-8")
    for variables in ({"PYTHONIOENCODING": "ascii"}, {"PYTHONIOENCODING": "latin-1"}):
        for command in (f"tracks show {track}", f"tracks check {track}"):
            done = subprocess.run(
                [*PYTHON_M, *command.split()], check=False, capture_output=True, env={**os.environ, **variables}
            )
            assert (done.returncode, done.stderr) == (0, b"")
            assert b"er Preis \\u20ac" in done.stdout


def test_a_file_name_that_is_no_text(tmp_path):
    """As file systems allow."""
    name = os.fsencode(tmp_path) + b"/\xff.toml"
    done = subprocess.run([*PYTHON_M, "tracks", "check", name], check=False, capture_output=True)
    assert done.returncode in (1, 2)
    assert b"Traceback" not in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (OSError(28, "No space left on device"), 74, "cannot read or write: No space left on device"),
        (OSError(5, "Input/output error", "a\nb"), 74, "cannot read or write: a b: Input/output error"),
        (PermissionError(13, "Permission denied", "/root/x"), 74, "/root/x: Permission denied"),
        (UnicodeEncodeError("ascii", "ü", 0, 1, "ordinal not in range(128)"), 74, "cannot read or write text: 'ascii'"),
        (SystemExit(3), 2, "code that was loaded ended the program: sys.exit(3)"),
        (SystemExit(), 2, "code that was loaded ended the program: sys.exit(None)"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_every_failure_has_one_line_and_a_code(error, code, words, monkeypatch, capsys):
    class Fails:
        def run(self):
            raise error

    monkeypatch.setattr(main_module, "parse", lambda _: Fails())
    assert main(["race"]) == code
    said = capsys.readouterr().err
    assert words in said
    assert said.startswith("error: ")
    assert said.count("\n") == 1


PATHS = [
    "train --out",
    "train --resume",
    "race --png",
    "race --html",
    "race --log",
    "race --gif",
    "evaluate --html",
    "tracks random --out",
    "export ring-4 --onnx",
    "new-pilot",
]


@pytest.mark.parametrize("flag", PATHS)
def test_an_empty_path_is_not_the_working_folder(flag, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*flag.split(), ""]) == 2
    error = capsys.readouterr().err
    assert "a path must not be empty" in error
    assert error.count("\n") == 1
    assert os.listdir(tmp_path) == []
