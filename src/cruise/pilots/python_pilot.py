"""Asks pilots in plain Python for their actions, and says clearly what is wrong with what they give."""

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np

from cruise.env.race_env import RaceEnv
from cruise.env.types import RaceState
from cruise.errors import CruiseError
from cruise.pilots.base import Crew, must_know
from cruise.pilots.foreign import Commanded, ForeignPilot, explain
from cruise.pilots.view import Snapshot, View, ViewBuilder, gates_of, take_snapshot

LEAST_LIMIT = 1e-3  # a pilot is not cut off sooner than this, because the clock has to be set [s]


def separate_python_pilots(env: RaceEnv, groups: tuple[Crew, ...]) -> tuple[tuple[Crew, ...], "PythonPilots"]:
    """The crews, with a stand-in for every pilot in plain Python in the compiled program, and those pilots."""
    python = {i: PythonPilot(env, crew) for i, crew in enumerate(groups) if isinstance(crew.pilot, ForeignPilot)}
    compiled = tuple(crew if i not in python else python[i].stand_in for i, crew in enumerate(groups))
    return compiled, PythonPilots(env, python)


class PythonPilots:
    """All pilots in plain Python of a race, or of a batch of races. True if there are any."""

    def __init__(self, env: RaceEnv, pilots: "dict[int, PythonPilot]") -> None:
        """`pilots` by the place of their crews."""
        self.env, self.pilots = env, pilots
        self._kinds = tuple(sorted({p.pilot.observation for p in pilots.values() if p.pilot.observation is not None}))

    def __bool__(self) -> bool:
        return bool(self.pilots)

    def ask(self, measured: RaceState, memories: tuple) -> tuple:
        """The crews' memories with the next action of every pilot here, which see the race as it was `measured`.

        Raises:
            CruiseError: a pilot raised an exception, took too long, or gave something that is no action.
        """
        snapshot = take_snapshot(self.env, measured, self._kinds)
        told = list(memories)
        for place, pilot in self.pilots.items():
            action = pilot.act(snapshot)  # [n, E, A]
            told[place] = jnp.asarray(np.moveaxis(action, 2, 0).reshape(memories[place].shape))
        return tuple(told)


class PythonPilot:
    """One pilot in plain Python and the drones it flies."""

    def __init__(self, env: RaceEnv, crew: Crew) -> None:
        """Nothing is made before the first step."""
        assert isinstance(crew.pilot, ForeignPilot)
        self.pilot, self.drones = crew.pilot, crew.drones
        self.stand_in = Crew(Commanded(crew.pilot.observation), crew.drones)
        must_know(env.track, self.pilot.name)
        self._size = env.of_drones(crew.drones).dynamics.action_size
        self._views = ViewBuilder(
            gates_of(env.course, env.track.gates), env.dynamics.control_dt, crew.pilot.agility, crew.pilot.observation
        )
        self._asked: dict[int, Callable[[View], Any]] = {}  # by row

    def act(self, snapshot: Snapshot) -> np.ndarray:
        """Actions [n, E, A], 0 for drones that have left the air."""
        views = self._views.views(snapshot, self.drones)
        wanted = np.asarray(views.airborne)
        if self.pilot.style == "batch":
            actions = self._act_batch(views, wanted)
        else:
            actions = np.zeros((len(wanted), self._size), np.float32)
            for row, view in self._views.one_by_one(views, wanted):
                ask = self._of_row(row, view.time)
                with self._in_time(view.drone, view.time, self.pilot.budget):
                    answer = ask(view)
                actions[row] = self._checked(answer, (self._size,), view.drone, view.time)
        return actions.reshape(len(self.drones), -1, self._size)

    def _act_batch(self, views: View, wanted: np.ndarray) -> np.ndarray:
        rows = np.flatnonzero(wanted)
        if len(rows) == 0:
            return np.zeros((len(wanted), self._size), np.float32)
        first = int(rows[0])
        drone, moment = np.asarray(views.drone)[first], np.asarray(views.time)[first]
        if not self._asked:
            self._asked[0] = self.pilot.make()
        with self._in_time(drone, moment, self.pilot.budget * len(rows)):
            answer = self._asked[0](views)
        actions = self._numbers(answer, (len(wanted), self._size), drone, moment)
        bad = rows[~np.isfinite(actions[rows]).all(axis=1)]
        if len(bad):
            worst = int(bad[0])
            self._checked(actions[worst], (self._size,), np.asarray(views.drone)[worst], np.asarray(views.time)[worst])
        return np.where(wanted[:, None], actions, 0.0).astype(np.float32)

    def _of_row(self, row: int, moment: Any) -> Callable[[View], Any]:
        """The object that flies a drone of a race; a new one where the race begins."""
        if self.pilot.style == "function":
            row = 0
        if row not in self._asked or (moment == 0 and self.pilot.style == "object"):
            self._asked[row] = self.pilot.make()
        return self._asked[row]

    @contextlib.contextmanager
    def _in_time(self, drone: Any, moment: Any, budget: float) -> Iterator[None]:
        """Raises CruiseError where the pilot within raises, or takes longer than `budget` [s]."""
        began = time.perf_counter()
        try:
            with cut_off(budget):
                yield
        except Overrun:
            raise CruiseError(self._fault(drone, moment, _too_slow(budget))) from None
        except (KeyboardInterrupt, CruiseError):
            raise
        except BaseException as error:  # sys.exit() among them
            raise CruiseError(self._fault(drone, moment, f"raised {explain(error)}")) from error
        took = time.perf_counter() - began
        if took > budget:
            raise CruiseError(self._fault(drone, moment, _too_slow(budget, took)))

    def _numbers(self, answer: Any, shape: tuple[int, ...], drone: Any, moment: Any) -> np.ndarray:
        try:
            action = np.asarray(answer, np.float32)
        except (TypeError, ValueError):
            got = f"gave {type(answer).__name__} {_short(answer)}"
            raise CruiseError(self._fault(drone, moment, f"{got}, expected {self._wanted(shape)}")) from None
        if action.shape != shape:
            got = f"gave an array of shape {list(action.shape)}"
            raise CruiseError(self._fault(drone, moment, f"{got}, expected {self._wanted(shape)}"))
        return action

    def _checked(self, answer: Any, shape: tuple[int, ...], drone: Any, moment: Any) -> np.ndarray:
        action = self._numbers(answer, shape, drone, moment)
        if not np.isfinite(action).all():
            got = f"gave {_short(action.tolist())}"
            raise CruiseError(self._fault(drone, moment, f"{got}, expected {self._wanted(shape)}"))
        return action

    def _wanted(self, shape: tuple[int, ...]) -> str:
        numbers = f"{self._size} finite numbers in [-1, 1]"
        return numbers if len(shape) == 1 else f"shape {list(shape)}: {numbers} for each drone"

    def _fault(self, drone: Any, moment: Any, what: str) -> str:
        return f"pilot {self.pilot.name!r}, drone {int(drone) + 1}, {float(moment):.2f} s into the race: {what}"


def _too_slow(budget: float, took: float | None = None) -> str:
    needed = "was not done within" if took is None else f"took {1e3 * took:.6g} ms, more than"
    return f"{needed} its budget of {1e3 * budget:.6g} ms; make it faster, or give it more (--budget-ms)"


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."


class Overrun(BaseException):
    """A pilot's time is over. No Exception, so that the pilot does not catch it by mistake."""


@contextlib.contextmanager
def cut_off(seconds: float) -> Iterator[None]:
    """Raise Overrun in what runs inside and has not ended after `seconds`, even in an endless loop.

    It needs the main thread, where Python handles signals; elsewhere nothing is cut off.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def stop(*_: object) -> None:
        raise Overrun

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, max(seconds, LEAST_LIMIT))
    try:
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
    finally:  # even where the time is over just now
        signal.signal(signal.SIGALRM, before)
