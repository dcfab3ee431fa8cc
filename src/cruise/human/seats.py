"""Places for people: what each has said last, and what is still to be told to it."""

import asyncio
import json
import time
from typing import Any

import numpy as np

from cruise.human.messages import Ready, Refused, Settings, Sticks, rates_of, read_message
from cruise.pilots.human import HOLD, HUMAN, MODES, Controls

STALL = 0.5  # sticks are believed for so long; pages repeat them ten times as often [s]
GIVE_UP = 5.0  # after so long on hold in a race a drone is out [s]
MOST_MESSAGES = 500  # a second


class Outbox:
    """The newest message of every kind that has not been sent: who does not read holds up nobody and costs nothing."""

    def __init__(self) -> None:
        self._waiting: dict[str, str] = {}
        self._some = asyncio.Event()

    def put(self, kind: str, content: Any) -> None:
        """Say something instead of what was said of this kind before, if that still waits."""
        self._waiting[kind] = json.dumps({kind: content}, separators=(",", ":"), allow_nan=False)
        self._some.set()

    async def get(self) -> str:
        """The message that waits longest."""
        await self._some.wait()
        message = self._waiting.pop(next(iter(self._waiting)))
        if not self._waiting:
            self._some.clear()
        return message


class Seat:
    """One person's place in all races, whether somebody sits there or not."""

    def __init__(self, drone: int, modes: tuple[str, ...], usual: Settings) -> None:
        self.drone, self.modes, self.settings = drone, modes, usual
        self.outbox: Outbox | None = None  # None: nobody sits there
        self.sticks = Sticks(0, (0.0,) * 4)
        self.ready = False
        self.heard = 0.0  # when the last sticks came [s]
        self._second, self._messages = 0, 0

    @property
    def taken(self) -> bool:
        """Whether a page is connected."""
        return self.outbox is not None

    @property
    def name(self) -> str:
        """What race logs call who sits here."""
        return f"{HUMAN} {self.settings.name}".strip()

    def sit(self) -> Outbox:
        """Somebody takes the place; what his page is to be told."""
        self.outbox, self.ready, self.heard = Outbox(), False, 0.0
        return self.outbox

    def leave(self) -> None:
        """The page is gone."""
        self.outbox, self.ready = None, False

    def tell(self, kind: str, content: Any) -> None:
        """Tell the page something, if there is one."""
        if self.outbox is not None:
            self.outbox.put(kind, content)

    def hear(self, text: str | bytes) -> None:
        """Take a message of the page. Raises Refused where it is none, or where there are too many."""
        now = time.monotonic()
        self._second, self._messages = (int(now), 0) if int(now) != self._second else (self._second, self._messages)
        self._messages += 1
        if self._messages > MOST_MESSAGES:
            raise Refused("too many messages")
        message = read_message(text, self.modes)
        if isinstance(message, Sticks):
            self.sticks, self.heard = message, now
        elif isinstance(message, Settings):
            self.settings = message
        elif isinstance(message, Ready):
            self.ready = True

    def attentive(self, now: float) -> bool:
        """Whether sticks have come of late."""
        return self.taken and now - self.heard <= STALL


def controls_of(seats: list[Seat], now: float) -> Controls:
    """What all of them tell their drones, for one race in a batch: arrays [..., n, 1]."""
    told = [seat.settings for seat in seats]
    modes = [MODES.index(s.settings.mode) if s.attentive(now) else HOLD for s in seats]

    def column(values: list[float]) -> np.ndarray:
        return np.array(values, np.float32)[:, None]

    values: dict[str, Any] = {
        "sticks": np.array([seat.sticks.positions for seat in seats], np.float32).T[:, :, None],
        "mode": np.array(modes, np.int32)[:, None],
        "rates": np.moveaxis(np.array([rates_of(one) for one in told], np.float32), 0, 2)[..., None],
        "tilt": column([np.radians(one.tilt) for one in told]),
        "speed": column([one.speed for one in told]),
        "centred": column([float(one.centred) for one in told]),
    }
    return Controls(**values)
