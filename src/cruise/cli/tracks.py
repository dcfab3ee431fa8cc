"""`cruise tracks list | show NAME | check FILE | draw NAME | import FILE | random`."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Column, Table

from cruise.cli.console import make_console
from cruise.cli.outputs import check_output
from cruise.config import Track
from cruise.files import write_whole
from cruise.presets import TRACKS
from cruise.racing.random_track import USUAL_GATES, random_track
from cruise.racing.solids import outlines
from cruise.racing.track_file import (
    document_faults,
    load_one_track,
    read_document,
    save_track,
    track_faults,
    track_warnings,
)
from cruise.racing.track_geometry import lap_length, segment_lengths
from cruise.racing.track_import import import_track
from cruise.racing.track_schema import shown

TrackArgument = Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME|FILE")]


@dataclass(frozen=True)
class List:
    """List the built-in tracks."""

    def run(self) -> int:
        """Print a table of names, gates, lengths and laps."""
        table = Table("track", *(_right(title) for title in ("gates", "lap [m]", "laps")))
        for track in TRACKS.values():
            table.add_row(track.name, str(len(track.gates)), f"{lap_length(track.gates):.2f}", str(track.laps))
        make_console().print(table)
        return 0


@dataclass(frozen=True)
class Show:
    """Show the gates of a track."""

    track: TrackArgument
    """Name of a built-in track, or path of a TOML file."""

    def run(self) -> int:
        """Print a table of gates, then the lap and the limits."""
        track = load_one_track(self.track)
        _print_track(track)
        print(_summary(track))
        print(f"bounds {_corner(track.bounds_low)} to {_corner(track.bounds_high)} m")
        print(f"gate frames {track.frame_width:g} m wide")
        print(f"a drone farther than {track.leave_distance:g} m from every gate has left the track")
        return 0


@dataclass(frozen=True)
class Check:
    """Check a track file: exit code 0 and a summary, or 1 and every fault on a line of its own."""

    track: TrackArgument
    """Path of a TOML file, or name of a built-in track."""

    def run(self) -> int:
        """Print the summary, or the faults to standard error."""
        builtin = TRACKS.get(self.track)
        faults = track_faults(builtin) if builtin else document_faults(read_document(self.track))
        for fault in faults:
            print(f"{shown(self.track)}: {fault}", file=sys.stderr)
        if faults:
            return 1
        track = load_one_track(self.track)
        for warning in track_warnings(track):
            print(f"{shown(self.track)}: warning: {warning}", file=sys.stderr)
        print(f"{shown(self.track)}: no faults; {_summary(track)}")
        return 0


@dataclass(frozen=True)
class Draw:
    """Draw a picture of a track."""

    track: TrackArgument
    """Name of a built-in track, or path of a TOML file."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """The picture (.png); by default NAME.png."""

    def run(self) -> int:
        """Write the picture."""
        track = load_one_track(self.track)
        out = self.out or Path(f"{Path(self.track).stem}.png")
        check_output("--out", out, ".png")
        from cruise.report.track_figure import draw_track  # noqa: PLC0415  (imports Matplotlib)

        write_whole(out, draw_track(track))
        print(f"picture {out}")
        return 0


@dataclass(frozen=True)
class Import:
    """Make a track file of another program's: lsy_drone_racing (TOML), marl-racing or rpg_time_optimal (YAML)."""

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """Its configuration or track."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE.toml")]
    """The track file to write."""
    name: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The track's name. By default that of the file."""
    opening: float = 1.5
    """Width and height of gates, where the file says only where they stand [m]."""

    def run(self) -> int:
        """Write the file, and say what is worth a word."""
        check_output("--out", self.out, ".toml")
        track = import_track(self.file, self.name, self.opening)
        save_track(track, self.out)
        for warning in track_warnings(track):
            print(f"{shown(self.file)}: warning: {warning}", file=sys.stderr)
        print(f"track {self.out}\n{_summary(track)}")
        return 0


@dataclass(frozen=True)
class Random:
    """Draw a track at random that can be flown."""

    seed: int = 0
    """The same seed gives the same track."""
    gates: int = USUAL_GATES
    """How many, from 3 to 40."""
    difficulty: float = 0.5
    """From 0, wide bends nearly level, to 1: close, shuffled, at all heights, gates one above the other."""
    obstacles: int = 0
    """Poles and walls beside the way from gate to gate, up to 60."""
    tilt: float = 0.0
    """Largest roll and pitch of the gates, up to 60 [deg]."""
    out: Path | None = None
    """Write it to this TOML file."""

    def run(self) -> int:
        """Print the gates, or write the file."""
        track = random_track(self.seed, self.gates, self.difficulty, self.obstacles, math.radians(self.tilt))
        if self.out is None:
            _print_track(track)
        else:
            save_track(track, self.out)
            print(f"track {self.out}")
        print(_summary(track))
        return 0


@dataclass(frozen=True)
class Tracks:
    """List, show, check and draw tracks."""

    command: (
        Annotated[List, tyro.conf.subcommand("list")]
        | Annotated[Show, tyro.conf.subcommand("show")]
        | Annotated[Check, tyro.conf.subcommand("check")]
        | Annotated[Draw, tyro.conf.subcommand("draw")]
        | Annotated[Import, tyro.conf.subcommand("import")]
        | Annotated[Random, tyro.conf.subcommand("random")]
    )

    def run(self) -> int:
        """Run the sub-command and give its exit code."""
        return self.command.run()


def _gate_table(track: Track) -> Table:
    """Roll, pitch and shape only where some gate is tilted or round."""
    leans, is_round = (
        any(gate.roll or gate.pitch for gate in track.gates),
        any(gate.shape == "round" for gate in track.gates),
    )
    titles = ["gate", "x", "y", "z", "yaw", *(("pitch", "roll") if leans else ()), "width", "height", "to next"]
    table = Table(*map(_right, titles), *(("shape",) if is_round else ()), title=f"{track.name} (metres, degrees)")
    for number, (gate, way) in enumerate(zip(track.gates, segment_lengths(track.gates), strict=True), start=1):
        turns = [math.degrees(math.remainder(angle, 2 * math.pi)) for angle in (gate.yaw, gate.pitch, gate.roll)]
        shown = [f"{angle:.1f}" for angle in turns] if leans else [f"{turns[0]:.2f}"]
        height = gate.width if gate.shape == "round" else gate.height
        place, size = ([f"{value:.2f}" for value in part] for part in (gate.position_w, (gate.width, height, way)))
        table.add_row(str(number), *place, *shown, *size, *((gate.shape,) if is_round else ()))
    return table


def _motion_table(track: Track) -> Table:
    """Gates that move: how far to either side of where they are at rest, in what time to and fro."""
    table = Table("gate that moves", *map(_right, ("x", "y", "z", "yaw", "period [s]", "phase")))
    for number, gate in enumerate(track.gates, start=1):
        if gate.motion is not None:
            moves = gate.motion
            numbers = (*moves.sway_w, math.degrees(moves.swing), moves.period, math.degrees(moves.phase))
            table.add_row(str(number), *(f"{value:.2f}" for value in numbers))
    return table


def _solid_table(track: Track) -> Table:
    """Poles and walls by the upright boxes around them."""
    table = Table("solid", *map(_right, ("x", "y", "from z", "to z", "yaw", "length", "width")))
    for solid in outlines(track.obstacles):
        (x, y, z), (length, width, height) = solid.centre_w, solid.size
        numbers = (x, y, z - height / 2, z + height / 2, math.degrees(solid.yaw), length, width)
        table.add_row(solid.kind, *(f"{value:.2f}" for value in numbers))
    return table


def _print_track(track: Track) -> None:
    make_console().print(_gate_table(track))
    if track.moves:
        make_console().print(_motion_table(track))
    if track.obstacles:
        make_console().print(_solid_table(track))


def _right(title: str) -> Column:
    return Column(title, justify="right")


def _summary(track: Track) -> str:
    gates = "1 gate" if len(track.gates) == 1 else f"{len(track.gates)} gates"
    laps = "1 lap" if track.laps == 1 else f"{track.laps} laps"
    return f"{track.name}: {gates}, {lap_length(track.gates):.2f} m a lap, {laps}"


def _corner(corner: tuple[float, float, float]) -> str:
    return f"({', '.join(f'{value:g}' for value in corner)})"
