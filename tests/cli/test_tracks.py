"""`cruise tracks` and the dispatcher: what is printed, where, and with which exit code."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import pytest

from cruise import __version__
from cruise.cli import main as dispatcher
from cruise.cli.main import COMMANDS, main
from cruise.errors import CruiseError
from cruise.presets import TRACKS
from tests.racing.track_tables import GATE, MALFORMED, NAME, UNREADABLE

WITHOUT_JAX = """
import contextlib, io, json, sys
from cruise.cli.main import main
for line in sys.stdin:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(json.loads(line))
    assert not {"jax", "equinox", "matplotlib"} & set(sys.modules), "imported what it does not need"
    print(json.dumps([code, out.getvalue(), err.getvalue()]), flush=True)
"""


class Done(NamedTuple):
    """What became of a command."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture(scope="module")
def cruise() -> Iterator[Callable[..., Done]]:
    """Runs commands, one after the other, in a process of their own, which must not import JAX."""
    command = [sys.executable, "-c", WITHOUT_JAX]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:

        def run(*arguments: str) -> Done:
            process.stdin.write(json.dumps(arguments) + "\n")
            process.stdin.flush()
            return Done(*json.loads(process.stdout.readline()))

        yield run
        process.stdin.close()


@pytest.mark.parametrize("case", MALFORMED)
def test_check_names_every_fault_on_its_own_line(case, tmp_path, capsys):
    content, expected = MALFORMED[case]
    path = tmp_path / "track.toml"
    path.write_text(content)
    assert main(["tracks", "check", str(path)]) == 1
    output = capsys.readouterr()
    lines = output.err.splitlines()
    assert output.out == ""
    assert len(lines) == len(expected)
    assert all(any(line.startswith(f"{path}: {text}") for line in lines) for text in expected)
    assert main(["tracks", "show", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {lines[0]}")


@pytest.mark.parametrize("command", ["check", "show"])
@pytest.mark.parametrize("case", UNREADABLE)
def test_unreadable_files_give_one_line(case, command, tmp_path, capsys):
    content, expected = UNREADABLE[case]
    path = tmp_path / "track.toml"
    path.write_bytes(content)
    assert main(["tracks", command, str(path)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith(f"error: {path}: {expected}")
    assert output.err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "code", "expected"),
    [
        (["tracks", "show", "rnig"], 2, "error: unknown track 'rnig': did you mean 'ring'?"),
        (["tracks", "check", "no/such.toml"], 2, "error: no/such.toml: no such track file"),
        (["tracks", "check", "/"], 2, "error: /: is a directory, not a track file"),
        (
            ["trakcs", "list"],
            2,
            "error: unknown command 'trakcs': did you mean 'tracks'? commands: race, fly, replay, train",
        ),
        (["xyz"], 2, "error: unknown command 'xyz': commands: race, fly, replay, train"),
        (["tracks"], 2, "Expected one of {list, show, check, draw, import, random}"),
        (["tracks", "shwo"], 2, "Available subcommands: list, show, check"),
        (["tracks", "show"], 2, "NAME|FILE"),
        (["tracks", "list", "--bogus"], 2, "Unrecognized options: --bogus"),
        (["--bogus"], 2, "Unrecognized options: --bogus"),
        (["tracks", "show", "ring", "figure-eight"], 2, "Unrecognized options: figure-eight"),
    ],
)
def test_bad_command_lines_say_what_is_wrong(arguments, code, expected, cruise):
    result = cruise(*arguments)
    assert result.returncode == code
    assert expected in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""


def test_list_without_jax(cruise):
    result = cruise("tracks", "list")
    assert (result.returncode, result.stderr) == (0, "")
    rows = [line.split() for line in result.stdout.splitlines()]
    for name, gates, length in (("ring", "5", "58.95"), ("figure-eight", "6", "56.80")):
        assert any({name, gates, length, "3"} <= set(row) for row in rows)


def test_show_prints_every_gate(capsys):
    assert main(["tracks", "show", "figure-eight"]) == 0
    output = capsys.readouterr().out
    for gate in TRACKS["figure-eight"].gates:
        assert all(f"{value:.2f}" in output for value in gate.position_w)
    assert "figure-eight: 6 gates, 56.80 m a lap, 3 laps" in output
    assert "bounds (-20, -15, 0) to (20, 15, 12) m" in output


def test_show_prints_a_name_as_it_is(tmp_path, capsys):
    path = tmp_path / "track.toml"
    path.write_text('name = "[red]a[/red]"\n' + GATE)
    assert main(["tracks", "show", str(path)]) == 0
    output = capsys.readouterr().out
    assert "[red]a[/red] (metres, degrees)" in output
    assert "[red]a[/red]: 1 gate, 0.00 m a lap, 3 laps" in output


def test_check_of_a_sound_track(tmp_path, capsys):
    path = tmp_path / "track.toml"
    path.write_text("laps = 1\n" + NAME + GATE)
    assert main(["tracks", "check", str(path)]) == 0
    assert main(["tracks", "check", "ring"]) == 0
    output = capsys.readouterr()
    assert output.out.splitlines() == [
        f"{path}: no faults; test: 1 gate, 0.00 m a lap, 1 lap",
        "ring: no faults; ring: 5 gates, 58.95 m a lap, 3 laps",
    ]
    assert output.err == ""


def test_help_names_every_command_without_loading_it(cruise):
    result = cruise("--help")
    assert result.returncode == 0
    for name in COMMANDS:
        assert name in result.stdout
    assert cruise("--version").stdout == f"cruise {__version__}\n"


@pytest.mark.parametrize(
    ("raised", "code", "line"),
    [
        (CruiseError("two\nlines"), 2, "error: two lines\n"),
        (KeyboardInterrupt(), 130, "error: interrupted\n"),
        (SystemExit(7), 2, "error: code that was loaded ended the program: sys.exit(7)\n"),
        (SystemExit(), 2, "error: code that was loaded ended the program: sys.exit(None)\n"),
    ],
)
def test_what_ends_a_command_becomes_a_line_and_a_code(raised, code, line, monkeypatch, capsys):
    @dataclass(frozen=True)
    class Failing:
        def run(self) -> int:
            raise raised

    monkeypatch.setattr(dispatcher, "parse", lambda arguments: Failing())
    assert main(["tracks", "list"]) == code
    assert capsys.readouterr().err == line


def test_a_reader_that_goes_away_is_no_error():
    code = "import sys; from cruise.cli.main import main; sys.exit(main(['tracks', 'check', 'ring']))"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 141


def test_a_random_track_is_shown_or_written_and_can_be_checked(cruise, tmp_path):
    shown = cruise("tracks", "random", "--seed", "3", "--gates", "6", "--difficulty", "0.8")
    assert shown.returncode == 0
    assert "random-3 (metres, degrees)" in shown.stdout
    path = tmp_path / "drawn.toml"
    written = cruise("tracks", "random", "--seed", "3", "--gates", "6", "--difficulty", "0.8", "--out", str(path))
    assert written.stdout.splitlines() == [f"track {path}", shown.stdout.splitlines()[-1]]
    assert cruise("tracks", "check", str(path)).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["random", "--difficulty", "2"], "difficulty must be from 0 to 1, not 2.0"),
        (["random", "--gates", "2"], "a random track has from 3 to 40 gates, not 2"),
        (["show", "random"], "random is a new track in every race: write one with `cruise tracks random --out FILE`"),
    ],
)
def test_what_no_random_track_can_be_is_said_in_one_line(arguments, words, cruise):
    told = cruise("tracks", *arguments)
    assert (told.returncode, told.stdout) == (2, "")
    assert told.stderr == f"error: {words}\n"


STRANGE = "[red]prize $5[/red] :cat:"


def test_a_name_is_printed_as_it_is(tmp_path, capsys):
    """Brackets are no markup, and colons no pictures."""
    path = tmp_path / "track.toml"
    path.write_text(f'name = "{STRANGE}"\n[[gates]]\nposition = [0, 0, 2]\nyaw_deg = 0\n')
    assert main(["tracks", "show", str(path)]) == 0
    assert f"{STRANGE} (metres, degrees)" in capsys.readouterr().out


def test_tilt_and_solids_are_shown(capsys):
    assert main(["tracks", "random", "--seed", "1", "--obstacles", "4", "--tilt", "20"]) == 0
    shown = capsys.readouterr().out
    assert "pitch" in shown
    assert shown.count("pole ") + shown.count("wall ") == 4
    assert main(["tracks", "random", "--seed", "1"]) == 0
    assert "pitch" not in capsys.readouterr().out


def test_a_track_is_drawn(tmp_path, capsys):
    out = tmp_path / "lsy.png"
    assert main(["tracks", "draw", "lsy-2", "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"picture {out}\n"
    assert out.read_bytes().startswith(b"\x89PNG")
    assert main(["tracks", "draw", "lsy-2", "--out", str(tmp_path / "lsy.gif")]) == 2
    assert "--out must name a .png file" in capsys.readouterr().err
