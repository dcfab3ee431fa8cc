"""`cruise limit`: how fast a vehicle could fly a track at all."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from cruise.cli.console import make_console
from cruise.cli.line_up import described
from cruise.cli.outputs import check_output
from cruise.config import Track
from cruise.errors import CruiseError
from cruise.extras import import_extra
from cruise.racing.track_file import load_one_track
from cruise.vehicles import load_vehicle

if TYPE_CHECKING:
    from cruise.limit.lap import Limit
    from cruise.limit.transcription import Dash


@dataclass(frozen=True)
class FindLimit:
    """Compute the time-optimal lap of a vehicle on a track."""

    track: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="NAME|FILE")]
    """Built-in track, or path of a TOML file."""
    vehicle: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "racer"
    """Built-in vehicle (`cruise vehicles` lists them), or path of a TOML file."""
    standing: bool = False
    """From hovering in the middle of gate 1, not in periodic flight."""
    laps: int = 1
    """Laps from standing that are optimal as a whole; in periodic flight, how often the log repeats the lap."""
    start: Annotated[tuple[float, float, float] | None, described("X Y Z")] = None
    """In place of laps, from hovering at this place, gate 1 first, to a free end; with --gates [m]."""
    gates: int | None = None
    """How many gates are passed from --start, round and round. By default every gate once."""
    stop: bool = False
    """End hovering in the middle of the last gate of --start, in place of flying on."""
    balls: Annotated[float | None, described("RADIUS")] = None
    """Pass gates within so much of their centres, in place of through their openings [m]."""
    margin: float = 0.25
    """Kept from the edges of every opening, and from poles and walls [m]."""
    steps: int | None = None
    """From gate to gate, in each of which a control is held: more are finer. 20 if not given; not for `paper`."""
    largest_change: float | None = None
    """Of an action from one step of the controller to the next, 2 if not given; only for `paper`, gentle at 0.2."""
    log: Annotated[Path | None, described("FILE")] = None
    """Where to write the flight as a race log (.npz), for `cruise replay RACE.npz --ghost FILE`."""

    def run(self) -> int:
        """Solve, print the lap and its splits, write the log."""
        check_output("--log", self.log, ".npz")
        track, vehicle = load_one_track(self.track), load_vehicle(self.vehicle)
        import_extra("casadi", "limit", "the limit needs CasADi")
        from cruise.limit.lap import MAX_LAPS, Options, find_limit  # noqa: PLC0415  (imports CasADi, and JAX with the rotors)
        from cruise.limit.log import limit_log  # noqa: PLC0415

        if not 1 <= self.laps <= MAX_LAPS:
            raise CruiseError(f"--laps must be between 1 and {MAX_LAPS}, not {self.laps}")
        options = Options(self.margin, self.laps if self.standing else 0, self._dash(track), self.balls)
        options = replace(options, steps=self.steps, largest_change=self.largest_change)
        with make_console(stderr=True).status("searching; a vehicle that is flown in steps takes a minute or two"):
            limit = find_limit(track, vehicle, options)
        print("\n".join(told(limit)))
        if self.log is not None:
            limit_log(limit, self.laps).save(self.log)
            print(f"log      {self.log}")
        return 0

    def _dash(self, track: Track) -> "Dash | None":
        """From --start. Raises CruiseError where flags do not go together."""
        from cruise.limit.transcription import Dash  # noqa: PLC0415  (imports CasADi)

        if self.start is None:
            for flag, given in (("--gates", self.gates is not None), ("--stop", self.stop)):
                if given:
                    raise CruiseError(f"{flag} is about the flight from --start X Y Z: give both")
            return None
        if self.laps != 1:
            raise CruiseError("--start X Y Z is flown once: say how far by --gates, not by --laps")
        return Dash(self.start, len(track.gates) if self.gates is None else self.gates, self.stop)


def told(limit: "Limit") -> list[str]:
    """What was found, line by line."""
    kind, what = "from standing" if limit.standing_laps else "in periodic flight", "lap   "
    if limit.dash is not None:
        x, y, z = limit.dash.start_w
        kind, what = f"from ({x:g}, {y:g}, {z:g}) through {limit.dash.gates} gates", "time  "
        kind += ", to a stop" if limit.dash.stop else ""
    if limit.ball is not None:
        kind += f", each within {limit.ball:g} m"
    times = ", ".join(f"{time:.3f}" for time in limit.lap_times)
    splits = " ".join(f"{time:.3f}" for time in limit.lap.duration)
    struck = ", ".join(str(gate + 1) for gate in limit.frames_struck)
    note = [f"beware   this line runs through the frame of gate {struck}"] if struck else []
    solids = ", ".join(str(number + 1) for number in limit.solids_struck)
    note += [f"beware   this line runs through obstacle {solids}"] if solids else []
    return [
        f"{limit.track.name} by {limit.vehicle.name} ({limit.equations}), {kind}",
        f"{what}   {times} s",
        f"splits   {splits} s",
        f"speed    {limit.mean_speed:.2f} m/s on average, {limit.top_speed:.2f} m/s at most; "
        f"{limit.nominal_speed:.2f} m/s along the polygon of gates",
        *note,
    ]
