"""Whose fault it is when two drones touch: a rule that looks at the race log alone.

It is judged as things stood `REACTION` seconds before the contact, when both could still do something about it. The
first of these that holds decides:

off course
    One of the two flew by its gate and has not passed it since: who comes back gives way (FIA International Sporting
    Code, Appendix L, chapter IV, 2: a car that left the track rejoins only where it is safe).
crossing
    At the contact the two were at different parts of the course, which pass near each other: shared, as nobody
    overtakes anybody.
following
    One was clear ahead and the other in its wake: the one that follows keeps clear, whatever the one ahead does (ICAO
    Annex 2, 3.2.2.4: the aircraft that is being overtaken has the right of way; Racing Rules of Sailing 12).
moved across
    Had both gone on as they were, turning as they did, they would have missed each other, and one of them did nearly
    all that brought them together: it is at fault (Appendix L, IV, 2: no more than one change of direction, and room
    for who is alongside; Racing Rules of Sailing 16.1: who changes course gives the other room to keep clear).
overtaking
    One was clear ahead, in another lane: the one that overtakes keeps clear, as above.
alongside
    Neither was: shared.

The rule knows no sides and no numbers: swapping the drones swaps the blame, and a mirrored race is judged alike.
"""

from typing import NamedTuple

import numpy as np

from cruise.evaluation.course_line import course_line
from cruise.storage.race_log import EventKind, RaceLog

REACTION = 0.5  # before the contact [s]: two reaction times of a human pilot
OVERLAP = 2.0  # who leads by more collision distances than this is clear ahead
ELSEWHERE = 5.0  # two that touch and are farther apart along the course than this are at different parts of it [m]
WAKE = 2.0  # who is not farther from the path of the one ahead than this many collision distances is in its wake
PAST = 1.5  # of a path that counts as its wake [s]
SLOW = 1.0  # below which it does not matter where a drone flies [m/s]
TURN = 0.1  # over which it is seen how a drone turns [s]
MOST = 0.75  # of what brought two together, from which on the other had no part in it
RULES = ("off course", "crossing", "following", "moved across", "overtaking", "alongside")


class Contact(NamedTuple):
    """Two drones that touched. `fault` sums to 1; the drones are in order of their numbers."""

    time: float  # [s]
    drones: tuple[int, int]
    fault: tuple[float, float]
    rule: str  # of `RULES`
    closing_speed: float  # at the contact [m/s]

    def fault_of(self, drone: int) -> float:
        """The share of a drone, 0 where it was not there."""
        return sum(share for one, share in zip(self.drones, self.fault, strict=True) if one == drone)


def contacts(log: RaceLog) -> list[Contact]:
    """All contacts between drones in a race, in order of time."""
    rows = np.flatnonzero(log.event_kind == EventKind.COLLISION_DRONE).tolist()
    found: dict[tuple[int, int], Contact] = {}
    for row in rows:
        one, two = sorted((int(log.event_drone[row]), int(log.event_other[row])))
        if (one, two) not in found:
            pair = _Pair(log, (one, two), float(log.event_time[row]))
            rule, fault = pair.judged()
            found[one, two] = Contact(pair.time, (one, two), (fault, 1.0 - fault), rule, pair.closing_speed())
    return list(found.values())


class _Pair:
    """The two drones of a contact. Rows of arrays are theirs, in order."""

    def __init__(self, log: RaceLog, drones: tuple[int, int], time: float) -> None:
        self.log, self.drones, self.time = log, drones, time
        self.reach = log.collision_distance * max(1.0, log.collision_aspect)
        self.at = min(int(time / log.control_dt), len(log.time) - 1)  # the last sample before the contact
        self.before = max(0, self.at - self._samples(REACTION))

    def judged(self) -> tuple[str, float]:
        """The rule that holds and the fault of the first of the two."""
        strayed = [is_off_course(self.log, drone, self.time) for drone in self.drones]
        if strayed[0] != strayed[1]:
            return "off course", float(strayed[0])
        if abs(self._lead_on_course(self.at)) > ELSEWHERE:
            return "crossing", 0.5
        lead = self._lead()
        clear, follower = abs(lead) > OVERLAP * self.reach, int(lead > 0)
        if clear and self._in_wake(follower):
            return "following", 1.0 - follower
        crossed = self._who_moved_across()
        if crossed is not None:
            return "moved across", 1.0 - crossed
        return ("overtaking", 1.0 - follower) if clear else ("alongside", 0.5)

    def closing_speed(self) -> float:
        """At the contact [m/s]."""
        offset, motion = (np.diff(rows, axis=0)[0] for rows in (self._position(self.at), self._velocity(self.at)))
        return float(-(offset @ motion) / max(float(np.linalg.norm(offset)), 1e-9))

    def _samples(self, seconds: float) -> int:
        return max(1, round(seconds / self.log.control_dt))

    def _position(self, sample: int) -> np.ndarray:
        return self.log.position_w[sample, self.drones].astype(np.float64)

    def _velocity(self, sample: int) -> np.ndarray:
        return self.log.velocity_w[sample, self.drones].astype(np.float64)

    def _lead(self) -> float:
        """How far the first was before the second [m], along the way they flew; along the course where they stood.

        The course alone would not do: where drones cut a corner it is not the way they fly.
        """
        velocity = self._velocity(self.before)
        direction = (velocity / np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), SLOW)).sum(axis=0)
        length = float(np.linalg.norm(direction))
        if length < 1.0:  # both slow, or one against the other
            return self._lead_on_course(self.before)
        one, two = self._position(self.before)
        return float((one - two) @ direction) / length

    def _lead_on_course(self, sample: int) -> float:
        line, log = course_line(self.log), self.log
        one, two = (line.coordinates(log.position_w[[sample], d], log.next_gate[[sample], d]) for d in self.drones)
        return float(line.ahead(one[0, 0], two[0, 0]))

    def _in_wake(self, follower: int) -> bool:
        """Whether the one that follows was near where the other had flown."""
        path = self.log.position_w[
            max(0, self.before - self._samples(PAST)) : self.before + 1, self.drones[1 - follower]
        ]
        here = self._position(self.before)[follower]
        return bool(_distance_to_path(here, path.astype(np.float64)) <= WAKE * self.reach)

    def _who_moved_across(self) -> int | None:
        """Which of the two, 0 or 1, did nearly all that brought them together; None: neither, or they met unmoved."""
        expected = self._going_on()
        gap = expected[1] - expected[0]
        apart = float(np.linalg.norm(gap))
        if apart <= self.reach:
            return None
        moved = (self._position(self.at) - expected) @ (gap / apart) * np.array([1.0, -1.0])
        towards = np.maximum(moved, 0.0)
        most = int(towards.argmax())
        return most if towards[most] >= max(apart - self.reach, MOST * towards.sum()) else None

    def _going_on(self) -> np.ndarray:
        """Where the two would be at the contact if each had gone on as it was, its acceleration constant."""
        seconds = (self.at - self.before) * self.log.control_dt
        earlier = max(0, self.before - self._samples(TURN))
        turn = self._velocity(self.before) - self._velocity(earlier)
        acceleration = turn / max((self.before - earlier) * self.log.control_dt, 1e-9)
        return self._position(self.before) + seconds * self._velocity(self.before) + seconds**2 / 2 * acceleration


def _distance_to_path(point: np.ndarray, path: np.ndarray) -> float:
    """From a point [3] to a line through points [T, 3]."""
    start, along = path[:-1], np.diff(path, axis=0)
    if len(along) == 0:
        return float(np.linalg.norm(point - path[0]))
    share = ((point - start) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12)
    nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
    return float(np.linalg.norm(point - nearest, axis=1).min())


def is_off_course(log: RaceLog, drone: int, time: float) -> bool:
    """Whether a drone has flown by its gate and not passed it since."""
    mine = (log.event_drone == drone) & (log.event_time < time)
    kinds = log.event_kind[mine]
    turns = kinds[np.isin(kinds, (EventKind.CROSSING, EventKind.MISSED_GATE))]
    return bool(len(turns) and turns[-1] == EventKind.MISSED_GATE)
