"""The page says of a race what the metrics say, is small, and holds nothing that could run or load."""

import base64
import hashlib
import json
import re

import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.evaluation.metrics import overtakes, race_result
from cruise.palette import drone_colour
from cruise.viewer.packing import looks_ahead, pack_race
from cruise.viewer.page import replay_page
from tests.storage.logs import small_log
from tests.viewer.races import FIELD, Circler, circle_race

NOT_CODE = "</script><script>alert(1)</script><!--"


def page_data(page):
    """The data in a page, as the browser reads them."""
    text = re.search(rb'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL).group(1)
    return json.loads(text)


def test_results_are_those_of_the_metrics():
    log = circle_race()
    result, data = race_result(log), pack_race(log, "seed 7")
    assert data["ranking"] == list(result.ranking)
    assert data["outcome"] == "nobody finishes, 1 out"
    for drone, expected, packed in zip(range(4), result.drones, data["drones"], strict=True):
        assert packed["fate"] == expected.fate
        assert packed["colour"] == drone_colour(drone)
        assert len(packed["crossings"]) == expected.gates_passed
        np.testing.assert_allclose(packed["crossings"], FIELD[drone].crossings(14.0), atol=1e-4)
    assert data["drones"][2]["crash"] == 6.0
    assert data["drones"][2]["samples"]["count"] == 61
    assert {event["kind"] for event in data["events"]} == {"collision_ground", "overtake"}


def test_overtakes_are_those_that_are_counted():
    log = circle_race(seconds=30.0, laps=3)
    found = overtakes(log)
    assert len(found) == race_result(log).overtakes >= 2
    when, drone, other, gate, number = found[0]
    ours, theirs = FIELD[drone].crossings(30.0), FIELD[other].crossings(30.0)
    crossing = np.argmin(np.abs(ours - when))
    assert ours[crossing] == pytest.approx(when)
    assert ours[crossing] < theirs[crossing]
    assert ours[crossing - 1] > theirs[crossing - 1]
    assert (gate, number) == (crossing % 4, crossing)


def test_winner_and_losses_are_named():
    log = circle_race(seconds=12.0, laps=1)
    assert pack_race(log, "")["outcome"] == "drone 2 wins, 1 out"
    assert pack_race(log, "")["drones"][1]["finish"] == pytest.approx(FIELD[1].crossings(12.0)[4], abs=1e-4)


def test_camera_sits_in_the_body_only_of_a_drone_that_looks_ahead():
    log = circle_race()
    assert looks_ahead(log)
    assert not looks_ahead(circle_race(euler=0 * log.euler))
    assert not looks_ahead(circle_race(velocity_w=0 * log.velocity_w))


def test_four_drones_for_a_minute_at_50_hz_are_under_two_megabytes():
    """On wavy lines with the noise of a real flight, which differences cannot predict."""
    rng = np.random.default_rng(0)
    log = circle_race(seconds=60.0, rate=50, laps=8)
    shape = log.position_w.shape
    noise = {
        "position_w": log.position_w + 0.01 * rng.normal(size=shape).cumsum(axis=0).astype(np.float32),
        "velocity_w": log.velocity_w + 0.1 * rng.normal(size=shape).astype(np.float32),
        "euler": log.euler + 0.05 * rng.normal(size=shape).astype(np.float32),
    }
    page = replay_page([circle_race(seconds=60.0, rate=50, laps=8, **noise)], ["seed 0"])
    assert 600_000 < len(page) < 1_200_000


def test_names_are_text_and_cannot_run():
    log = circle_race(pilots=np.array([NOT_CODE] * 4), track=NOT_CODE + "{{data}}")
    page = replay_page([log], [NOT_CODE])
    assert NOT_CODE.encode() not in page
    assert b"<title>&lt;/script&gt;" in page
    data = page_data(page)
    assert data["races"][0]["label"] == data["races"][0]["drones"][0]["pilot"] == NOT_CODE


def test_only_the_code_that_was_built_in_may_run():
    page = replay_page([small_log()], ["x"])
    policy = re.search(rb'http-equiv="Content-Security-Policy" content="(.*?)"', page).group(1).decode()
    script = re.findall(rb"<script>(.*?)</script>", page, re.DOTALL)
    assert len(script) == 1
    digest = base64.b64encode(hashlib.sha256(script[0]).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy
    assert policy.startswith("default-src 'none'; ")
    assert not re.search(
        rb"<(link|img|iframe|object|embed)\b|<script[^>]*\bsrc=|@import|url\(", page.split(b"<script>")[0]
    )


def test_the_licence_of_what_is_built_in_comes_with_it():
    assert b"Permission is hereby granted, free of charge" in replay_page([small_log()], ["x"])


def test_a_ghost_flies_along():
    slow = circle_race((Circler(-0.2, 0.3, 8.0, 3.0),), pilots=np.array(["yesterday"]))
    drones = page_data(replay_page([circle_race()], ["now"], slow))["races"][0]["drones"]
    assert [drone["ghost"] for drone in drones] == [False] * 4 + [True]
    assert drones[4]["pilot"] == "yesterday"
    with pytest.raises(CruiseError, match="the ghost flew track 'ring', whose gates are not those of 'circle'"):
        replay_page([circle_race()], ["now"], small_log(gates=4))


def test_strange_races_give_pages():
    for log in (
        small_log(samples=1),
        small_log(drones=16),
        circle_race((FIELD[0],)),
        small_log(event_time=0 * small_log().event_time),
    ):
        assert page_data(replay_page([log], ["x"]))["races"][0]["duration"] == pytest.approx(log.time[-1])
