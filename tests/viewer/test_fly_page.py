"""A scripted person flies a lap in a real browser, by a gamepad that is a script too."""

import pytest

from cruise.evaluation.metrics import race_result
from cruise.human import game, seats
from cruise.storage.race_log import load_race_log
from tests.human.games import served, small_game

SMALL = (320, 240)  # the processor draws it
GAMEPAD = """() => {
  const buttons = Array.from({ length: 16 }, () => ({ pressed: false, value: 0 }));
  window.pad = { index: 0, connected: true, mapping: 'standard', axes: [0, 0, 0, 0], buttons };
  navigator.getGamepads = () => [window.pad];
}"""


def shows(element, text):
    return f"document.querySelector('#{element}').textContent === '{text}'"


@pytest.fixture
def page(tmp_path, open_page, monkeypatch):
    """The page of a game; a machine that is busy with other things is waited for."""
    monkeypatch.setattr(seats, "STALL", 30.0)
    monkeypatch.setattr(game, "GIVE_UP", 60.0)
    with served(small_game(tmp_path)) as server:
        place = f"127.0.0.1:{server.port}/"
        page = open_page(server.address, size=SMALL, allowed=(f"http://{place}", f"ws://{place}"))
        page.until("fly.own === 0 && fly.frames > 0")
        yield page
        page.close()


def test_a_scripted_person_flies_a_lap(page, tmp_path):
    page.until(shows("message", "Ready?"))
    page.run(GAMEPAD)
    page.run("() => { pad.buttons[9].pressed = true }")
    page.until("fly.phase.name === 'racing'")
    assert page.run("fly.input.device") == "gamepad"
    page.run("() => { pad.axes[3] = -1 }")
    page.until("fly.rows.find(row => row.drone === 0).passed > 2")
    assert page.run("fly.heard") > 0
    page.until(shows("lap-number", "lap 1/1"))
    page.until("Number(document.querySelector('#speed-now').textContent) > 3")
    page.until("fly.phase.name === 'over'")
    assert "human" in page.text("#results")
    (file,) = tmp_path.glob("*.npz")
    assert race_result(load_race_log(file)).drones[0].fate == "finished"


def test_keys_touch_and_settings(page):
    page.page.keyboard.down("ArrowUp")
    page.until("fly.input.sticks[1] === 1")
    page.page.keyboard.up("ArrowUp")
    page.until("fly.input.sticks[1] === 0")
    page.page.keyboard.press("3")
    assert page.run("fly.settings.value.mode") == "acro"
    page.run("() => { fly.input.device = 'touch' }")
    page.until("document.documentElement.dataset.device === 'touch'")
    box = page.page.locator("#stick-right").bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.page.mouse.move(*middle)
    page.page.mouse.down()
    page.page.mouse.move(middle[0], middle[1] - box["height"])
    page.until("fly.input.sticks[1] === 1")
    page.page.mouse.up()
    page.until("fly.input.sticks[1] === 0")
    page.page.keyboard.press("o")
    page.page.fill("[name=fov]", "120")
    page.page.fill("[name=rate-0-1]", "9999")
    assert page.run("[fly.settings.value.fov, fly.settings.value.rates[0][1]]") == [120, 2000]
    assert page.run("JSON.parse(localStorage['cruise-fly']).own.fov") == 120
