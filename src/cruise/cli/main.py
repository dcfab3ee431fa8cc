"""The command `cruise`: finds the sub-command, parses its flags, runs it, turns errors into one line and an exit code.

A sub-command is a frozen dataclass in a module of its own, with a method `run() -> int` that gives the exit code. Only
the module of the sub-command at hand is imported, so that `cruise --help` and `cruise tracks` need no JAX.
"""

import contextlib
import difflib
import functools
import importlib
import io
import operator
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, Protocol, runtime_checkable

import tyro

from cruise import __version__
from cruise.cli.paths import refusing_empty_paths
from cruise.cli.streams import drop_output, ready_streams
from cruise.cli.vehicle_flag import vehicle_flags
from cruise.errors import CruiseError, one_line

BAD_INPUT = 2
CANNOT_WRITE = 74  # as EX_IOERR of sysexits.h
HELP = ("--help", "-h")
FRAME = "╭╮╰╯│─├┤"  # what the parser draws around its messages
BROKEN_PIPE = 128 + signal.SIGPIPE
INTERRUPTED = 128 + signal.SIGINT


@runtime_checkable
class Command(Protocol):
    """A parsed sub-command."""

    def run(self) -> int:
        """Do it and give the exit code."""


class Entry(NamedTuple):
    """Where a sub-command lives."""

    module: str
    dataclass: str
    summary: str


COMMANDS = {
    "race": Entry("cruise.cli.race", "Race", "Race policies against each other; print the result and draw it."),
    "fly": Entry("cruise.cli.fly", "Fly", "Fly yourself, in the browser, against pilots and friends."),
    "replay": Entry("cruise.cli.replay", "Replay", "Replay race logs in the browser."),
    "train": Entry("cruise.cli.train", "Train", "Train a policy through the curriculum, or resume a run."),
    "evaluate": Entry("cruise.cli.evaluate", "Evaluate", "Measure pilots over many races, with confidence intervals."),
    "robustness": Entry(
        "cruise.cli.robustness", "Robustness", "Measure pilots when vehicle, air, gates or sensors are off."
    ),
    "racecraft": Entry("cruise.cli.racecraft", "Racecraft", "Fly pilots through situations with known answers."),
    "handicap": Entry(
        "cruise.cli.handicap", "MeasureHandicap", "Measure how often a drone with more thrust gets past one with less."
    ),
    "sim-to-sim": Entry("cruise.cli.sim_to_sim", "SimToSim", "Fly pilots unchanged in simulators that are not ours."),
    "tracks": Entry("cruise.cli.tracks", "Tracks", "List, show, check and draw tracks."),
    "limit": Entry("cruise.cli.limit", "FindLimit", "Compute the time-optimal lap of a vehicle on a track."),
    "tune": Entry("cruise.cli.tune", "Tune", "Search for the settings of training, reward weights included."),
    "tune-planner": Entry(
        "cruise.cli.tune_planner", "TunePlanner", "Find how fast the SE-IBR planner can fly a track."
    ),
    "reproduce": Entry("cruise.cli.experiments", "Reproduce", "Run the paper's experiments again and write a report."),
    "sweep": Entry("cruise.cli.experiments", "Sweep", "Run many of those experiments at once, here or on a cluster."),
    "new-pilot": Entry("cruise.cli.new_pilot", "NewPilot", "Write a pilot in Python to start from."),
    "export": Entry("cruise.cli.export", "Export", "Write a policy as an ONNX model or a C header."),
    "vehicles": Entry("cruise.cli.vehicles", "Vehicles", "List, show, check and write vehicles."),
    "companion": Entry(
        "cruise.cli.companion", "CompanionProgram", "Fly a real drone by a policy from the computer aboard."
    ),
    "betaflight": Entry(
        "cruise.cli.betaflight", "Betaflight", "Say what the firmware of a drone must be set to, or check what it is."
    ),
    "identify": Entry("cruise.cli.identify", "Identify", "Fit a vehicle to flight logs."),
    "observations": Entry(
        "cruise.cli.observations", "Observations", "List what policies may observe by, number by number."
    ),
    "policies": Entry("cruise.cli.policies", "Policies", "List the shipped policies."),
}


@dataclass(frozen=True)
class Unused:
    """Stands for a sub-command whose module is not needed."""

    def run(self) -> int:
        """Never called: the parser chooses the sub-command that was loaded."""
        raise AssertionError("a sub-command that was not loaded was chosen")


def main(argv: Sequence[str] | None = None) -> int:
    """Run `cruise` with `argv`, or the process's own arguments, and give the exit code.

    0 is success, 1 a negative finding (as `cruise tracks check` has), 2 bad input, 74 output that cannot be written,
    130 Ctrl-C, 141 a reader of the output that has gone.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    fault = ready_streams()
    if fault:
        return _complain(f"cannot write the output: {fault}", CANNOT_WRITE)
    code = _told(lambda: _run(arguments))
    flushed = _told(sys.stdout.flush)
    if flushed:
        drop_output()
    return code or flushed


def _told(action: Callable[[], int | None]) -> int:
    """Do something, say in one line why it failed, and give the exit code."""
    try:
        return action() or 0
    except CruiseError as error:
        return _complain(str(error))
    except KeyboardInterrupt as stop:
        return _complain(str(stop) or "interrupted", INTERRUPTED)
    except BrokenPipeError:
        return BROKEN_PIPE
    except OSError as error:
        place = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
        return _complain(f"cannot read or write: {place}{error.strerror or one_line(error)}", CANNOT_WRITE)
    except UnicodeError as error:
        return _complain(f"cannot read or write text: {one_line(error)}", CANNOT_WRITE)


def _run(arguments: list[str]) -> int:
    if arguments == ["--version"]:
        print(f"cruise {__version__}")
        return 0
    if any(word.endswith(("crazyflow", "sim-to-sim")) for word in arguments):  # wanted before anything imports SciPy
        os.environ.setdefault("SCIPY_ARRAY_API", "1")
    try:
        command = parse(arguments)
    except SystemExit as stop:  # --help
        return stop.code if isinstance(stop.code, int) else BAD_INPUT if stop.code else 0
    try:
        return command.run()
    except SystemExit as stop:
        if isinstance(stop.__context__, BrokenPipeError):  # Rich meets it first
            return BROKEN_PIPE
        raise CruiseError(f"code that was loaded ended the program: sys.exit({stop.code!r})") from stop


def parse(arguments: list[str]) -> Command:
    """Flags to the dataclass of the chosen sub-command.

    Where its defaults depend on its flags they are parsed twice, the second time with the defaults for what they said.

    Raises:
        CruiseError: a flag or a value that cannot be.
        SystemExit: after help was printed.
    """
    chosen = arguments[0] if arguments else "--help"
    if chosen not in COMMANDS and not chosen.startswith("-"):
        close = difflib.get_close_matches(chosen, COMMANDS, n=1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise CruiseError(f"unknown command {chosen!r}: {hint}commands: {', '.join(COMMANDS)} (see cruise --help)")
    kind: Any = _load(COMMANDS[chosen]) if chosen in COMMANDS else None
    if not hasattr(kind, "usual"):
        return _parse_as(arguments, chosen, kind, None)
    asked = [word for word in arguments if word not in HELP]
    try:
        usual = kind.usual(_parse_as(asked, chosen, kind, None))
    except CruiseError:
        if asked == arguments:
            raise
        usual = None  # the help is shown all the same
    return _parse_as(arguments, chosen, kind, usual)


def _parse_as(arguments: list[str], chosen: str, kind: Any, usual: Any) -> Command:
    """The sub-command that is `chosen`, a dataclass `kind` with the defaults of `usual`, if that is not None."""
    kinds = [_described(name, entry, (kind, usual) if name == chosen else None) for name, entry in COMMANDS.items()]
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint), vehicle_flags(), refusing_empty_paths():
            command: Command = tyro.cli(
                functools.reduce(operator.or_, kinds),
                prog="cruise",
                description="Learning to race drones against drones.",
                args=arguments,
                config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise CruiseError(_one_line(complaint.getvalue())) from None
    return command


def _one_line(boxed: str) -> str:
    """The parser's message without its frame, and without the help that `--help` gives."""
    words = boxed.translate({ord(c): " " for c in FRAME}).split()
    message = " ".join(word for word in words if set(word) != {"-"} or len(word) < 3)
    for title in ("Parsing error ", "Unrecognized options ", "Value error "):
        message = message.removeprefix(title)
    message = message.partition(" Argument helptext: ")[0]
    message = re.sub(r"no type matching .* Got errors: .* - <class [^>]*>: ", "", message)
    return re.sub(r"^Error parsing \S+: (?=--|unknown )", "", message)  # these say for themselves what is meant


def _load(entry: Entry) -> Any:
    """The dataclass of a sub-command. Its class method `usual`, if it has one, gives the defaults for what was asked.

    What was asked is the sub-command as parsed with the defaults of its fields.
    """
    return getattr(importlib.import_module(entry.module), entry.dataclass)


def _described(name: str, entry: Entry, loaded: tuple[Any, Any] | None) -> Any:
    """A sub-command for the parser; one that was not loaded is only listed."""
    if loaded is None:
        return Annotated[Unused, tyro.conf.subcommand(name, description=entry.summary)]
    kind, usual = loaded
    if usual is None:
        return Annotated[kind, tyro.conf.subcommand(name, description=entry.summary)]
    return Annotated[kind, tyro.conf.subcommand(name, default=usual, description=entry.summary)]


def _complain(message: str, code: int = BAD_INPUT) -> int:
    print(f"error: {' '.join(message.splitlines())}", file=sys.stderr)
    return code
