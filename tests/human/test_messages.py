"""What a page may say: our own messages are taken, fifty others are not."""

import json

import pytest

from cruise.human import seats
from cruise.human.messages import LARGEST, Ready, Refused, Settings, Sticks, read_message, usual_settings
from cruise.human.seats import Seat, controls_of
from cruise.pilots.human import ASSISTED, HOLD
from cruise.presets import VEHICLES
from tests.human.hostile import HOSTILE, USUAL, settings, sticks

MODES = ("assisted", "angle", "acro")


def test_what_a_page_says():
    assert read_message(sticks([0, 0.5, -1, 1], n=7), MODES) == Sticks(7, (0.0, 0.5, -1.0, 1.0))
    assert read_message('{"ready":true}', MODES) == Ready()
    told = read_message(settings(name=" Ada "), MODES)
    assert isinstance(told, Settings)
    assert (told.name, told.mode, told.rates[2]) == ("Ada", "assisted", (100.0, 500.0, 0.3))


@pytest.mark.parametrize("message", HOSTILE)
def test_what_no_page_says(message):
    with pytest.raises(Refused):
        read_message(message, MODES)


def test_there_are_fifty_and_each_fits_into_a_message():
    assert len({str(message) for message in HOSTILE}) == 50
    assert max(map(len, HOSTILE)) <= LARGEST


def test_a_mode_that_the_vehicle_lacks():
    with pytest.raises(Refused, match="mode"):
        read_message(settings(mode="acro"), ("assisted",))


@pytest.mark.parametrize("name", VEHICLES)
def test_a_newcomer_s_settings_are_ones_that_a_page_may_send(name):
    usual = usual_settings(VEHICLES[name])
    content = {field: getattr(usual, field) for field in USUAL}
    assert read_message(json.dumps({"settings": content}), MODES) == usual


def test_sticks_that_grow_old_hold_the_drone(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(seats.time, "monotonic", lambda: clock[0])
    seat = Seat(0, MODES, usual_settings(VEHICLES["racer"]))
    assert controls_of([seat], 100.0).mode.item() == HOLD  # nobody there
    seat.sit()
    seat.hear(sticks([0, 1, 0, 0]))
    assert controls_of([seat], 100.4).mode.item() == ASSISTED
    assert controls_of([seat], 100.6).mode.item() == HOLD
    for _ in range(seats.MOST_MESSAGES - 1):
        seat.hear(sticks([0, 0, 0, 0]))
    with pytest.raises(Refused, match="too many"):
        seat.hear(sticks([0, 0, 0, 0]))


def test_who_does_not_read_keeps_one_message_of_a_kind():
    seat = Seat(0, MODES, usual_settings(VEHICLES["racer"]))
    outbox = seat.sit()
    for number in range(10_000):
        seat.tell("state", number)
        seat.tell("order", number)
    assert outbox._waiting == {"state": '{"state":9999}', "order": '{"order":9999}'}
