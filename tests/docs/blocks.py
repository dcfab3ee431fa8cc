"""The code blocks of the documentation, and how each kind is run: what is long in miniature, what repeats once."""

import contextlib
import functools
import io
import re
import shlex
import shutil
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from cruise.cli.limit import FindLimit
from cruise.cli.main import main, parse
from cruise.cli.train import Train
from cruise.racing.track_file import load_track, track_faults
from cruise.training.session import Session
from cruise.training.validation import check_config
from cruise.vehicles import load_vehicle
from cruise.vehicles.file import file_faults

ROOT = Path(__file__).parent.parent.parent
PAGES = ("README.md", *sorted(f"docs/{page.name}" for page in (ROOT / "docs").glob("*.md")))
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)

# Flags that make a command short. They come last, where they win.
MINIATURE = {
    "train": "--step-scale 0.001 --races 64 --episodes 4 --evaluation-races 8 --evaluation-steps 20",
    "evaluate": "--episodes 1",
    "racecraft": "--runs 1",
    "robustness": "--episodes 1",
    "sim-to-sim": "--episodes 1 --track ring",
    "handicap": "--episodes 1 --track ring",
    "race": "--laps 1 --races 1 --clip 0 1",
    "replay": "--clip 0 1",
    "limit": "--steps 8",
    "reproduce": "--list",
}
# More of them where a command has the first flag.
SHORTER = {("limit", "--start"): "--gates 3", ("limit", "--standing"): "--laps 1"}
AS_IT_IS = ({"reproduce", "--report-only"}, {"limit", "paper"})  # take seconds, and no flag makes them shorter
WATCHED = "--watch"  # serves until somebody stops it: tests/viewer/test_live.py does
WITH_OTHERS = "--coordinator"  # waits for the other processes: tests/training/test_processes.py has them
# Commands that compile or solve for seconds. One line of each kind runs; lines that differ from it by these values
# alone are parsed, and what they name is looked up.
COSTLY = ("evaluate", "limit", "race", "train")
LOGGED, TRAINED = "--log", "--out"  # what a later line of the page may read: then it is always written
VALUES = {"--vehicle", "--track", "--drones", "--episodes", "--seed", "--step-scale", TRAINED}
# Flags of one kind: the first says at once what each of the others says of one thing.
SPREADS = {"--randomise": {"--mass-spread", "--thrust-spread", "--extra-delay", "--gust-speed"}}
ELSEWHERE = {"sweep", "tune", "fly", "betaflight", "companion"}  # want Ray, a person, firmware, a drone


class Block(NamedTuple):
    """A fenced block of a page."""

    page: str
    line: int
    language: str
    text: str


def blocks(page: str) -> list[Block]:
    """All of a page's, in order."""
    text = (ROOT / page).read_text()
    return [Block(page, text[: m.start()].count("\n") + 1, m[1], m[2]) for m in FENCE.finditer(text)]


def run_page(page: str, folder: Path) -> None:
    """Run a page from top to bottom in a folder of its own, as a reader in a fresh clone would."""
    for name in ("examples", "results"):
        (folder / name).symlink_to(ROOT / name)
    names: dict = {"__name__": page}
    for block in blocks(page):
        {"python": _python, "py": _elsewhere, "toml": _toml, "c": _c, "": _shell}[block.language](block, folder, names)


def _python(block: Block, folder: Path, names: dict) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(block.text, f"{block.page}:{block.line}", "exec"), names)


def _elsewhere(block: Block, folder: Path, names: dict) -> None:
    """It wants libraries that only `make clients` installs, which runs it."""
    assert block.page == "docs/clients.md"
    compile(block.text, f"{block.page}:{block.line}", "exec")


def _toml(block: Block, folder: Path, names: dict) -> None:
    path = folder / f"{tomllib.loads(block.text)['name']}.toml"
    path.write_text(block.text)
    if "gates" in tomllib.loads(block.text):
        assert track_faults(load_track(str(path))) == []
    else:
        assert file_faults(path) == []


def _c(block: Block, folder: Path, names: dict) -> None:
    """The first line includes a header that a command before has written; the rest is the body of a function."""
    include, body = block.text.split("\n", 1)
    program = f"{include}\nint main(void) {{\n{body}\nreturn command[0] > 1e9f;\n}}\n"
    (folder / "block.c").write_text(program)
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))))
    subprocess.run([compiler, "-std=c99", "-Wall", "-Werror", "block.c", "-lm", "-o", "block"], cwd=folder, check=True)
    subprocess.run([folder / "block"], check=True)


def _shell(block: Block, folder: Path, names: dict) -> None:
    for words in _commands(block):
        program, *arguments = words
        if program == "cruise":
            _cruise(block, arguments)
        elif program == "make":
            subprocess.run(["make", "-n", *arguments], cwd=ROOT, check=True, capture_output=True)
        elif program == "pip":
            _pip(arguments)
        elif program == "python":
            _module_or_script(arguments)
        else:
            raise AssertionError(f"{block.page}:{block.line}: no test runs {program!r}")


def _commands(block: Block) -> Iterator[list[str]]:
    for line in block.text.splitlines():
        words = shlex.split(line.replace("[--json]", "--json"), comments=True)
        if words:
            yield [words[0].removeprefix(".venv/bin/"), *words[1:]]


def _cruise(block: Block, arguments: list[str]) -> None:
    command = arguments[0]
    short = [word for word in arguments if word != "--open"]
    first = command not in COSTLY or (block.page, arguments) == _first_of_kinds()[_kind(arguments)]
    read = _is_read(block, arguments)
    if not first and (command == "train" or not read):
        _look_up(parse(short))
        if read:
            _begin(parse([*short, *shlex.split(MINIATURE[command])]))
        return
    if WATCHED in short or WITH_OTHERS in short or ELSEWHERE & set(short):
        short = [command, "--help"]
    elif not any(flags <= set(short) for flags in AS_IT_IS):
        short += shlex.split(MINIATURE.get(command, ""))
        for (name, flag), more in SHORTER.items():
            short += more.split() if name == command and flag in short else []
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main(short)
    assert code == 0, f"{block.page}:{block.line}: cruise {shlex.join(short)}: {said.getvalue()[-500:]}"
    for flag in (word for word in arguments if word.startswith("--") and short[-1] == "--help"):
        assert flag in said.getvalue(), f"{block.page}:{block.line}: {flag}"


def _is_read(block: Block, arguments: list[str]) -> bool:
    """Whether the page may go on with what a line writes: a log, or a run whose folder it names again."""
    if TRAINED not in arguments:
        return LOGGED in arguments
    folder = arguments[arguments.index(TRAINED) + 1]
    return (ROOT / block.page).read_text().count(folder) > 1


def _kind(arguments: list[str]) -> frozenset[str]:
    """What a line asks for beside values: the command, its other flags, and what it says more than once."""
    flags = [word for word in arguments if word.startswith("--")]
    several = {f"{flag} again" for flag in flags if flags.count(flag) > 1}
    asked = frozenset(flags) - VALUES
    for name, parts in SPREADS.items():
        asked = asked - parts | {name} if asked & parts else asked
    return asked | several | {arguments[0]}


@functools.cache
def _first_of_kinds() -> dict[frozenset[str], tuple[str, list[str]]]:
    """The page and the words of the first line of each kind of the costly commands."""
    found: dict[frozenset[str], tuple[str, list[str]]] = {}
    for block in (block for page in PAGES for block in blocks(page) if not block.language):
        for program, *arguments in _commands(block):
            if program == "cruise" and arguments[0] in COSTLY:
                found.setdefault(_kind(arguments), (block.page, arguments))
    return found


def _look_up(command: Any) -> None:
    """Whatever a parsed line names is there and goes together."""
    if isinstance(command, Train):
        check_config(command.config)
    elif isinstance(command, FindLimit):
        load_track(command.track)
        load_vehicle(command.vehicle)
    else:
        command.line_up.match()


def _begin(command: Train) -> None:
    """A run that has learned nothing: all that later lines look for."""
    assert command.out is not None
    config = command.config
    session = Session(command.out, config, load_track(config.track), load_vehicle(config.vehicle))
    session.finish(lambda _: {})
    session.close()


def _pip(arguments: list[str]) -> None:
    """What is to be installed is the package with extras that it has, and pinned releases of others."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    pinned = {line.split("==")[0] for line in (ROOT / "constraints.txt").read_text().splitlines()}
    assert arguments[0] == "install"
    for word in arguments[1:]:
        if found := re.fullmatch(r"(?:\.|cruise-racing)\[([\w,]+)\]", word):
            assert set(found[1].split(",")) <= set(extras), word
        else:
            assert word in ("-e", "-c", "constraints.txt") or "==" in word or word in pinned, word


def _module_or_script(arguments: list[str]) -> None:
    """Benchmarks and examples have tests of their own; here, that they are where the page says."""
    if arguments[0] == "-m":
        place = ROOT.joinpath(*arguments[1].split("."))
        assert (place / "__main__.py").exists() or place.with_suffix(".py").exists(), arguments
    else:
        assert (ROOT / arguments[0]).exists(), arguments
