"""Whose fault a contact is: hand-made races with known answers, and the symmetries of the rule."""

import dataclasses

import numpy as np
import pytest

from cruise.config import Gate
from cruise.evaluation.blame import RULES, contacts
from cruise.evaluation.course_line import CourseLine, course_line
from cruise.storage.race_log import EventKind
from tests.storage.logs import small_log

RADIUS = 15.0  # [m]
DT, SAMPLES = 0.02, 101  # the contact is at the last sample
CORNERS = np.array([[0.0, 0.0, 2.0], [40.0, 0.0, 2.0], [40.0, 40.0, 2.0], [0.0, 40.0, 2.0]])
YAWS = np.array([0.0, 0.5, 1.0, 1.5]) * np.pi  # the first leg leads to gate 1 along x
BACK = np.arange(SAMPLES - 1, -1, -1)[:, None] * DT  # before the contact [s]


def straight(end, velocity):
    """[T, 3] towards `end`."""
    return np.asarray(end) - BACK * np.asarray(velocity)


def swerving(end, velocity, lane):
    """[T, 3] straight ahead `lane` metres to the left of `end`, until it crosses to it in the last 0.3 s."""
    across = lane * np.clip(BACK / 0.3, 0.0, 1.0)
    return straight(end, velocity) + across * np.array([0.0, 1.0, 0.0])


def turning(speed, end):
    """[T, 3] round a circle to the right, all to the same end whatever the speed."""
    angle = speed * BACK / RADIUS
    return np.asarray(end) - RADIUS * np.concatenate([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)


def braking(end, speed):
    """[T, 3] from `speed` to a stop in the last 0.4 s."""
    left = np.minimum(BACK, 0.4)
    gone = speed * (BACK - left) + speed / 0.4 * left**2 / 2
    return np.asarray(end) - gone * np.array([1.0, 0.0, 0.0])


def make_log(paths, gates=(1, 1), missed=()):
    """Two drones that touch at the end; `missed` flew by their gate before."""
    position = np.stack(paths, axis=1)
    events = [(0.1, drone, EventKind.MISSED_GATE, gates[drone], -1) for drone in missed]
    events += [((SAMPLES - 1) * DT, d, EventKind.COLLISION_DRONE, -1, 1 - d) for d in (0, 1)]
    time, drone, kind, gate, other = (np.array(column) for column in zip(*events, strict=True))
    return small_log(
        samples=SAMPLES,
        gates=4,
        time=DT * np.arange(SAMPLES),
        position_w=position,
        velocity_w=np.gradient(position, DT, axis=0),
        next_gate=np.tile(np.array(gates, np.int32), (SAMPLES, 1)),
        gate_position=CORNERS,
        gate_yaw=YAWS,
        event_time=time,
        event_drone=drone.astype(np.int32),
        event_kind=kind.astype(np.int32),
        event_gate=gate.astype(np.int32),
        event_other=other.astype(np.int32),
        control_dt=DT,
    )


HERE = (20.0, 0.0, 2.0)
AHEAD, LEFT = np.array([0.2, 0.0, 0.0]), np.array([0.0, 0.2, 0.0])
SLOW, FAST = (5.0, 0.0, 0.0), (12.0, 0.0, 0.0)
# Paths of two drones, what else is known, the rule and the fault of the first.
CASES = {
    "run into from behind": ([straight(HERE, FAST), straight(HERE + AHEAD, SLOW)], {}, "following", 1.0),
    "run into from behind in a turn": ([turning(12.0, HERE), turning(7.0, HERE + AHEAD)], {}, "following", 1.0),
    "run into while braking": ([straight(HERE, FAST), braking(HERE + AHEAD, 12.0)], {}, "following", 1.0),
    "overtaken from above": ([straight(HERE, (12.0, 0.0, -3.0)), straight(HERE + AHEAD, SLOW)], {}, "overtaking", 1.0),
    "the leader cuts in": (
        [straight(HERE, FAST), swerving(HERE + AHEAD, SLOW, 1.5)],
        {},
        "moved across",
        0.0,
    ),
    "the follower cuts in": (
        [swerving(HERE, FAST, 1.5), straight(HERE + AHEAD, SLOW)],
        {},
        "moved across",
        1.0,
    ),
    "one of two abreast swerves": (
        [straight(HERE, FAST), swerving(HERE + LEFT, FAST, 1.5)],
        {},
        "moved across",
        0.0,
    ),
    "two abreast close in": (
        [swerving(HERE, FAST, -1.0), swerving(HERE + LEFT, FAST, 1.0)],
        {},
        "alongside",
        0.5,
    ),
    "two abreast without room": ([straight(HERE, FAST), straight(HERE + LEFT, FAST)], {}, "alongside", 0.5),
    "one comes back to its gate": (
        [straight(HERE, FAST), straight(HERE + AHEAD, (-3.0, 0.0, 0.0))],
        {"missed": (1,)},
        "off course",
        0.0,
    ),
    "both come back": (
        [straight(HERE, FAST), straight(HERE + AHEAD, SLOW)],
        {"missed": (0, 1)},
        "following",
        1.0,
    ),
    "their ways cross": (
        [straight(HERE, FAST), straight(HERE + LEFT, (0.0, 8.0, 0.0))],
        {"gates": (1, 3)},
        "crossing",
        0.5,
    ),
}


def judged(paths, known):
    (contact,) = contacts(make_log(paths, **known))
    return contact


@pytest.mark.parametrize("name", CASES)
def test_known_answers(name):
    paths, known, rule, fault = CASES[name]
    contact = judged(paths, known)
    assert (contact.rule, contact.fault) == (rule, (fault, 1 - fault))
    assert contact.drones == (0, 1)
    assert contact.fault_of(0) == fault
    assert contact.fault_of(2) == 0


def test_every_rule_decides_somewhere():
    assert {rule for _, _, rule, _ in CASES.values()} == set(RULES)


@pytest.mark.parametrize("name", CASES)
def test_swapping_the_drones_swaps_the_blame(name):
    paths, known, rule, fault = CASES[name]
    other = {"missed": tuple(1 - d for d in known.get("missed", ())), "gates": known.get("gates", (1, 1))[::-1]}
    contact = judged(paths[::-1], other)
    assert (contact.rule, contact.fault) == (rule, (1 - fault, fault))


@pytest.mark.parametrize("name", CASES)
def test_a_mirrored_or_turned_race_is_judged_alike(name, monkeypatch):
    """The same on a track that is mirrored, turned and moved."""
    paths, known, rule, fault = CASES[name]
    mirror = np.array([1.0, -1.0, 1.0])
    angle, shift = 0.7, np.array([3.0, -5.0, 1.0])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    for place, yaw in (
        (lambda x: x * mirror, lambda y: -y),
        (lambda x: x @ turn.T + shift, lambda y: y + angle),
    ):
        monkeypatch.setitem(globals(), "CORNERS", place(CORNERS))
        monkeypatch.setitem(globals(), "YAWS", yaw(YAWS))
        contact = judged([place(path) for path in paths], known)
        monkeypatch.undo()
        assert (contact.rule, contact.fault) == (rule, (fault, 1 - fault))


def test_closing_speed():
    assert judged(*CASES["run into from behind"][:2]).closing_speed == pytest.approx(7.0)


def test_a_race_without_contacts_has_none():
    """Crossings and missed gates are none, whoever is near."""
    log = make_log([straight(HERE, FAST), straight(HERE, SLOW)], missed=(0, 1))
    alone = {"event_kind": np.full(4, EventKind.MISSED_GATE, np.int32), "event_other": np.full(4, -1, np.int32)}
    assert contacts(dataclasses.replace(log, **alone)) == []


def test_course_line_counts_on_through_gates_and_round_the_lap():
    gates = tuple(Gate(tuple(p), float(y)) for p, y in zip(CORNERS.tolist(), YAWS, strict=True))
    line = CourseLine(gates, 0.3)
    before, after = (line.coordinates(np.array([[40.0, y, 2.0]]), np.array([2]))[0] for y in (1.0, 2.0))
    assert before[1:] == pytest.approx([0, 0], abs=0.2)
    assert after[0] > before[0]
    beside = line.coordinates(np.array([[39.5, 0.5, 2.7]]), np.array([1]))[0]
    assert beside[1:] == pytest.approx([0.5, 0.7], abs=0.25)
    assert line.ahead(1.0, line.length - 1.0) == pytest.approx(2.0)
    assert line.ahead(line.length - 1.0, 1.0) == pytest.approx(-2.0)
    assert course_line(make_log(CASES["both come back"][0])).length == pytest.approx(line.length)
