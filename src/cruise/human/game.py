"""Race after race with people in it, in real time: who waits for whom, and what all of them are told."""

import asyncio
import dataclasses
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from cruise.errors import CruiseError
from cruise.evaluation.matches import Match
from cruise.evaluation.metrics import race_result
from cruise.human.laps import Board, laps_of
from cruise.human.live_race import LiveRace
from cruise.human.messages import usual_settings
from cruise.human.seats import GIVE_UP, Outbox, Seat, controls_of
from cruise.palette import drone_colour
from cruise.pilots.human import HumanPilot, flight_modes
from cruise.storage.race_log import RaceLog, flown_in
from cruise.viewer.packing import pack_scenery
from cruise.viewer.painting.scenery import track_scenery

COUNTDOWN = 3.0  # [s]
REMAINDER = 60.0  # when all people are done the others fly on for so long, unseen [s]
LATE = 0.25  # a race that has fallen behind by so much goes on from there and catches nothing up [s]
REMEMBERED = 20_000  # steps whose timing is known
BREATH = 20  # steps of what nobody watches between two looks at the pages
REST = 0.01  # that each lasts, for whoever else wants the processor [s]


class Timing(NamedTuple):
    """Of one control step."""

    late: float  # how long after its time it began [s]
    took: float  # [s]


@dataclass(frozen=True)
class Rules:
    """How races follow each other."""

    seed: int = 0
    countdown: float = COUNTDOWN  # [s]
    hurry: bool = False  # do not wait for the clock


class Game:
    """The seats, the race that is flown or was flown last, and the board."""

    def __init__(
        self, match: Match, board: Board, rules: Rules, ghosts: dict[str, Any], say: Callable[[str], None]
    ) -> None:
        """Nothing is flown yet, but everything is compiled.

        Args:
            match: its first drones, all those of a `HumanPilot`, are the seats.
            board: of best laps; its folder takes the logs.
            rules: how races follow each other.
            ghosts: laps by what the page calls them, as `ghost_of` gives them.
            say: prints a line for who started it.
        """
        self.match, self.board, self.rules, self.ghosts, self.say = match, board, rules, ghosts, say
        self.modes = flight_modes(match.vehicle)
        usual = usual_settings(match.vehicle)
        people = [drone for drone, pilot in enumerate(match.team) if isinstance(pilot, HumanPilot)]
        self.seats = [Seat(drone, self.modes, usual) for drone in people]
        self.timing: deque[Timing] = deque(maxlen=REMEMBERED)
        self.flown = 0  # races
        self.race = self._prepare()
        self.race.warm_up(controls_of(self.seats, 0.0))
        self.race = self._prepare()
        self.phase: dict[str, Any] = {"name": "grid"}
        self.results: list[dict[str, Any]] = []

    # Seats

    def sit(self) -> Seat | None:
        """The first free seat, taken; None where there is none."""
        seat = next((seat for seat in self.seats if not seat.taken), None)
        if seat is not None:
            self._welcome(seat, seat.sit())
        return seat

    def _welcome(self, seat: Seat, outbox: Outbox) -> None:
        vehicle = self.match.vehicle
        settings = dataclasses.asdict(usual_settings(vehicle))
        hover = vehicle.gravity / vehicle.agility
        outbox.put(
            "hello",
            {
                "seat": seat.drone,
                "track": self.match.track.name,
                "laps": self.match.laps,
                "scene": pack_scenery(track_scenery(self.match.track)),
                "dt": self.race.dt,
                "vehicle": {"name": vehicle.name, "modes": self.modes, "usual": settings, "hover": round(hover, 4)},
                "nose": "flight" if vehicle.airframe is None else "body",
            },
        )
        outbox.put("ghosts", self.ghosts)
        outbox.put("board", self._board())
        outbox.put("race", self._race())
        outbox.put("state", self._state())
        outbox.put("order", self.race.order.rows())
        if self.results:
            outbox.put("results", self.results)
        outbox.put("phase", self.phase)

    def tell(self, kind: str, content: Any) -> None:
        """Tell every page."""
        for seat in self.seats:
            seat.tell(kind, content)

    # Races

    async def run(self) -> None:
        """Race after race, until cancelled."""
        while True:
            await self._gather()
            if self.race.race.steps:
                self.race = self._prepare()
            self.tell("race", self._race())
            self.tell("order", self.race.order.rows())
            await self._count_down()
            again = await self._fly()
            await self._finish(again)

    async def _gather(self) -> None:
        """Wait until all who sit there are ready."""
        while not self._all_ready():
            self.tell("waiting", [seat.drone for seat in self.seats if seat.taken and not seat.ready])
            await asyncio.sleep(0.05)
        for seat in self.seats:
            seat.ready = False

    def _all_ready(self) -> bool:
        sitting = [seat for seat in self.seats if seat.taken]
        return bool(sitting) and all(seat.ready for seat in sitting)

    async def _count_down(self) -> None:
        self.tell("state", self._state())
        self._enter({"name": "countdown", "seconds": self.rules.countdown})
        await asyncio.sleep(0 if self.rules.hurry else self.rules.countdown)
        for seat in self.seats:
            if not seat.taken:
                self.race.retire(seat.drone)
        self._enter({"name": "racing"})
        self.tell("order", self.race.order.rows())

    async def _fly(self) -> bool:
        """Step after step, each at its time, until no person flies; whether all want to begin anew."""
        race, due = self.race, time.perf_counter()
        held = dict.fromkeys(range(len(self.seats)), 0.0)
        while not race.over and any(race.flying(seat.drone) for seat in self.seats):
            began = time.perf_counter()
            changed = race.step(controls_of(self.seats, time.monotonic()))
            self._mind_the_held(held)
            self.tell("state", self._state())
            if changed:
                self.tell("order", race.order.rows())
            ended = time.perf_counter()
            self.timing.append(Timing(began - due, ended - began))
            if self._all_ready():
                return True
            due = due + race.dt if ended - due < LATE else ended + race.dt
            await asyncio.sleep(0 if self.rules.hurry else max(0.0, due - time.perf_counter()))
        return False

    def _mind_the_held(self, held: dict[int, float]) -> None:
        """Drones of pages that have stalled or gone are out in the end [s of the race]."""
        now = time.monotonic()
        for number, seat in enumerate(self.seats):
            held[number] = 0.0 if seat.attentive(now) else held[number] + self.race.dt
            if held[number] > GIVE_UP and self.race.flying(seat.drone):
                self.race.retire(seat.drone)
                self.tell("order", self.race.order.rows())

    async def _finish(self, again: bool) -> None:
        """Let the others finish, keep the log, show who won. Whoever wants another race at once is not held up."""
        if not again:
            await self._fly_on()
        self.flown += 1
        if self.race.race.steps:
            log = self.race.log(tuple(self._names()))
            self.results = result_rows(log)
            self._keep(log)
        self.tell("board", self._board())
        if not again:
            self.tell("order", self.race.order.rows())
            self.tell("results", self.results)
            self._enter({"name": "over"})

    async def _fly_on(self) -> None:
        until = self.race.time + REMAINDER
        controls = controls_of(self.seats, time.monotonic())
        while not self.race.over and self.race.time < until:
            self.race.step(controls)
            if self.race.race.steps % BREATH == 0:
                await asyncio.sleep(REST)

    def _keep(self, log: RaceLog) -> None:
        """Write the log and the board; where that fails it is said, and races go on."""
        when = time.strftime("%Y-%m-%d %H:%M:%S")
        folder, stamp = self.board.folder, when.translate({ord("-"): None, ord(":"): None, ord(" "): "-"})
        file = f"{Path(log.track).stem}-{self.match.vehicle.name}-{stamp}-{self.flown}.npz"
        try:
            log.save(folder / file)
            for seat in self.seats:
                if self.board.add(log, file, seat.settings.mode, when, seat.drone):
                    self.ghosts["best"] = self.board.ghost()
                    self.tell("ghosts", self.ghosts)
        except CruiseError as error:
            self.say(f"not kept: {error}")
            self.tell("notice", str(error))
            return
        self.say(f"race {self.flown}  {told(log)}  {folder / file}")

    # What pages are told

    def _prepare(self) -> LiveRace:
        return LiveRace(self.match, self.rules.seed + self.flown)

    def _enter(self, phase: dict[str, Any]) -> None:
        self.phase = phase
        self.tell("phase", phase)

    def _names(self) -> list[str]:
        names = [pilot.name for pilot in self.match.team]
        for seat in self.seats:
            names[seat.drone] = seat.name
        return names

    def _race(self) -> dict[str, Any]:
        people = {seat.drone for seat in self.seats}
        drones = [
            {"number": d + 1, "pilot": name, "colour": drone_colour(d), "person": d in people}
            for d, name in enumerate(flown_in(self._names(), [one.name for one in self.match.vehicles]))
        ]
        return {"number": self.flown + 1, "first_gate": self.race.first_gate, "drones": drones}

    def _state(self) -> dict[str, Any]:
        return self.race.moment() | {"heard": [seat.sticks.number for seat in self.seats]}

    def _board(self) -> list[dict[str, Any]]:
        return [{"time": lap.time, "name": lap.name, "mode": lap.mode, "when": lap.when} for lap in self.board.here]


def result_rows(log: RaceLog) -> list[dict[str, Any]]:
    """The result of a race, best first; times in s, None where there is none."""
    result = race_result(log)

    def known(value: float) -> float | None:
        return None if math.isnan(value) else round(value, 3)

    rows = ((drone, result.drones[drone]) for drone in result.ranking)
    return [
        {
            "drone": drone,
            "pilot": log.names[drone],
            "fate": mine.fate,
            "time": known(mine.finish_time),
            "best": known(min((lap.time for lap in laps_of(log, drone)), default=math.nan)),
            "top": known(mine.top_speed),
        }
        for drone, mine in rows
    ]


def told(log: RaceLog) -> str:
    """A race in a line."""
    rows = result_rows(log)
    return ", ".join(f"{row['pilot']} {row['fate']}" + (f" {row['time']} s" if row["time"] else "") for row in rows)
