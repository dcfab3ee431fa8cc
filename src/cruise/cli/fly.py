"""`cruise fly`: people fly, in the browser, against pilots and against each other."""

import asyncio
import gc
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cruise.cli.compilation import prepare_flight
from cruise.cli.line_up import described
from cruise.cli.outputs import show
from cruise.errors import CruiseError
from cruise.processor import run_in_real_time
from cruise.racing.track_file import load_one_track
from cruise.vehicles import load_vehicle

if TYPE_CHECKING:
    from cruise.evaluation.matches import Match
    from cruise.human.game import Game
    from cruise.pilots.base import Pilot

MOST_DRONES = 8
LEAST_PACE = 0.2


@dataclass(frozen=True)
class Fly:
    """Fly yourself, in the browser: by gamepad, transmitter, keyboard or touch."""

    track: Annotated[str, described("NAME|FILE")] = "ring"
    """Built-in track, or path of a TOML file."""
    vehicle: Annotated[str, described("NAME|FILE")] = "racer"
    """What people fly: a built-in vehicle (`cruise vehicles` lists them), or path of a TOML file."""
    seats: int = 1
    """How many people can fly, each on a page of their own."""
    rivals: Annotated[int | None, described("N")] = None
    """How many pilots fly against them. By default as many as there are --pilot, or 3."""
    pilot: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, described("NAME|PATH|FILE.py:NAME")] = ()
    """Flies one rival, as in `cruise race`; repeat it, fewer take turns. By default the policy shipped for track and
    vehicle, or chaser where there is none."""
    rival_vehicle: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, described("NAME|FILE")] = ()
    """What one rival flies; repeat it, fewer take turns. By default what people fly."""
    rival_pace: float = 1.0
    """Pace of the rivals: 0.8 flies the same way in 1 / 0.8 of the time."""
    laps: Annotated[int | None, described("N")] = None
    """Laps to fly. By default the track's."""
    seed: int = 0
    """Seed of the first race's start; every other race has the next."""
    folder: Path = Path("flights")
    """Where race logs and the board of best laps go."""
    ghost: Annotated[Path | None, described("RACE.npz")] = None
    """The fastest lap of a race log flies along, translucent: one of `cruise limit --laps 2 --log FILE` for example.
    Your own best lap always does."""
    time_optimal: bool = False
    """Compute the time-optimal lap first, keep it in the folder, and let it fly along; needs the extra `limit`."""
    host: str = "127.0.0.1"
    """Address to serve on. By default nobody but this machine can reach it; 0.0.0.0 is every network it is on."""
    port: int = 0
    """Port to serve on; by default a free one."""
    open: bool = True
    """Open the browser."""

    def run(self) -> int:
        """Serve until Ctrl-C."""
        self._check()
        prepare_flight()
        from cruise.human.game import Game, Rules  # noqa: PLC0415  (imports JAX)
        from cruise.human.laps import Board  # noqa: PLC0415
        from cruise.storage.atomic import make_folder  # noqa: PLC0415

        match = self._match()
        make_folder(self.folder)
        board = Board(self.folder, match.track, match.vehicle.name)
        ghosts = {"best": board.ghost(), "limit": self._ghost(match)}
        print("getting ready; the first time this takes a minute", flush=True)
        game = Game(match, board, Rules(self.seed), ghosts, lambda line: print(line, flush=True))
        try:
            asyncio.run(self._serve(game))
        except KeyboardInterrupt:
            print()
        print(timing(game))
        return 0

    def _check(self) -> None:
        rivals = self._rivals
        if not 1 <= self.seats <= MOST_DRONES or not 0 <= rivals <= MOST_DRONES - self.seats:
            raise CruiseError(
                f"--seats and --rivals together must be from 1 to {MOST_DRONES}, with a seat at least: "
                f"got {self.seats} and {rivals}"
            )
        if not LEAST_PACE <= self.rival_pace <= 1:
            raise CruiseError(f"--rival-pace must be from {LEAST_PACE} to 1, got {self.rival_pace:g}")
        if self.ghost is not None and self.time_optimal:
            raise CruiseError("--ghost and --time-optimal both name a lap to fly along: give one or the other")

    @property
    def _rivals(self) -> int:
        named = max(len(self.pilot), len(self.rival_vehicle))
        return (named or 3) if self.rivals is None else self.rivals

    def _match(self) -> "Match":
        """People first, then their rivals."""
        from cruise.env.mixed import each_of  # noqa: PLC0415
        from cruise.evaluation.matches import Match, make_match  # noqa: PLC0415
        from cruise.evaluation.race_choices import find_fleet  # noqa: PLC0415
        from cruise.pilots.human import human_pilot  # noqa: PLC0415
        from cruise.vehicles import reference_to  # noqa: PLC0415

        track, vehicle = load_one_track(self.track), load_vehicle(self.vehicle)
        people = (human_pilot(reference_to(vehicle)),) * self.seats
        if not self._rivals:
            laps = make_match(track, 1, "hover", self.laps, vehicle=vehicle).laps
            return Match(track, people, laps, asked_for=vehicle)
        theirs = find_fleet(self.rival_vehicle or vehicle, self._rivals)
        fleet = each_of((vehicle,) * self.seats + theirs, self.seats + self._rivals)
        match = make_match(track, self._rivals, self._pilots(track.name), self.laps, vehicle=theirs)
        asked_for = fleet if len(set(fleet)) > 1 else vehicle
        return replace(match, team=people + self._slowed(match.team), asked_for=asked_for)

    def _slowed(self, rivals: "tuple[Pilot, ...]") -> "tuple[Pilot, ...]":
        from cruise.pilots.foreign import ForeignPilot  # noqa: PLC0415
        from cruise.pilots.paced import Paced  # noqa: PLC0415

        if self.rival_pace == 1:
            return rivals
        if any(isinstance(pilot, ForeignPilot) for pilot in rivals):
            raise CruiseError("--rival-pace slows pilots that are compiled, not those in plain Python")
        slow = {id(pilot): Paced(pilot, self.rival_pace) for pilot in rivals}
        return tuple(slow[id(pilot)] for pilot in rivals)

    def _pilots(self, track: str) -> list[str]:
        """Those named, or the one shipped for each rival's vehicle."""
        from cruise.storage.policy_file import shipped_name  # noqa: PLC0415

        def usual(vehicle: str) -> str:
            try:
                return shipped_name(track, self.seats + self._rivals, vehicle)
            except CruiseError:
                return "chaser"

        return list(self.pilot or map(usual, (self.rival_vehicle or (self.vehicle,))))

    def _ghost(self, match: "Match") -> dict[str, Any] | None:
        from cruise.human.laps import best_of, gates_key, ghost_of  # noqa: PLC0415
        from cruise.storage.race_log import load_race_log  # noqa: PLC0415

        path = self.ghost
        if self.time_optimal:
            path = self.folder / f"limit-{gates_key(match.track)}-{match.vehicle.name}.npz"
            if not path.exists():
                self._find_limit(path)
        if path is None:
            return None
        log = load_race_log(path)
        lap = best_of(log)
        if lap is None:
            raise CruiseError(f"--ghost {path} has no complete lap, from gate 1 to gate 1")
        return ghost_of(log, lap)

    def _find_limit(self, path: Path) -> None:
        from cruise.cli.limit import FindLimit  # noqa: PLC0415

        FindLimit(self.track, self.vehicle, log=path).run()

    async def _serve(self, game: "Game") -> None:
        from cruise.human.server import Server  # noqa: PLC0415

        async with Server(game, self.host, self.port) as server:
            away = f"\nothers   {server.elsewhere}" if server.elsewhere else ""
            print(f"fly      {server.address}{away}\nCtrl-C ends it", flush=True)
            if self.open:
                show(server.address)
            run_in_real_time()
            gc.freeze()  # what is there now stays: no need to look through it between two steps
            await game.run()


def timing(game: "Game") -> str:
    """How well the clock was kept."""
    if not game.timing:
        return "nothing was flown"
    late, took = (sorted(1e3 * value for value in column) for column in zip(*game.timing, strict=True))
    at = int(0.99 * (len(late) - 1))
    return f"{len(late)} steps: 99 % began within {late[at]:.1f} ms of their time and took at most {took[at]:.1f} ms"
