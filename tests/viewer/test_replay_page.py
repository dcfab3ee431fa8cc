"""The replay page in a real browser shows what the log says where the camera says, and asks the network for nothing."""

import numpy as np
import pytest

from cruise.evaluation.metrics import race_result
from cruise.palette import drone_colour
from cruise.viewer.page import write_replay
from cruise.viewer.standings import make_course, standings
from tests.viewer.browser import around, colour, hues, project
from tests.viewer.races import FIELD, GATES, circle_race

HIGHLIGHT = colour("#f0e442")  # of the gate that the followed drone flies to, in the dark scheme


@pytest.fixture(scope="module")
def shared(browser, race_file):
    """One page for all tests that leave its size and its scheme alone."""
    from tests.viewer.browser import Page

    page = Page(browser, race_file.as_uri())
    yield page
    assert page.complaints == []
    page.close()


@pytest.fixture
def page(shared):
    """The shared page as it was when it was opened."""
    if shared.state()["race"] != 0:
        shared.run("replay.showRace(0)")
    trail = {"length": 3, "bySpeed": False}
    shared.seek(0, camera="orbit", follow=None, trail=trail, theme="dark", speed=1)
    return shared


@pytest.mark.parametrize("t", [0.0, 3.14, 5.55, 9.0, 14.0])
def test_drones_are_where_they_were(page, t):
    state = page.seek(t)
    assert state["time"] == t
    assert not state["playing"]
    for circler, drone in zip(FIELD, state["drones"], strict=True):
        # 10 samples a second and millimetres between them: the curve leaves the circle by less than this.
        np.testing.assert_allclose(drone["position"], circler.position(t), atol=2e-3)
        if t < circler.crash:
            np.testing.assert_allclose(drone["velocity"], circler.velocity(t), atol=2e-2)
        forward = rotate(drone["attitude"], [1.0, 0.0, 0.0])
        heading = circler.velocity(min(t, circler.crash - 1e-6)) / (circler.rate * circler.radius)
        np.testing.assert_allclose(forward, heading, atol=2e-3)


def rotate(attitude, vector):
    x, y, z, w = attitude
    axis = np.array([x, y, z])
    return np.asarray(vector) + 2 * np.cross(axis, np.cross(axis, vector) + w * np.asarray(vector))


@pytest.mark.parametrize("t", [0.0, 0.3, 1.0, 4.4, 6.0, 9.0, 14.0])
def test_standings_are_those_that_python_finds(page, race, t):
    found, expected = page.seek(t)["standings"], standings(make_course(race), t)
    assert [row["drone"] for row in found] == [row.drone for row in expected]
    for ours, theirs in zip(found, expected, strict=True):
        assert (ours["passed"], ours["lap"], ours["status"]) == (theirs.passed, theirs.lap, theirs.status)
        assert ours["gap"] == pytest.approx(theirs.gap, abs=1e-3, nan_ok=True)
    if t == 14.0:
        assert [row["drone"] for row in found] == list(race_result(race).ranking)


def test_the_board_says_the_order(page):
    page.seek(2.0)
    assert rows(page) == ["1", "3", "2", "4"]
    page.seek(9.0)
    assert rows(page)[0] == "2"
    assert "hit the ground" in page.text("#board")
    page.seek(14.0, follow=1)
    assert f"{FIELD[1].crossings(14.0)[GATES]:.2f}" in page.text("#laps")


def rows(page):
    return [text.split()[0] for text in page.page.locator("#board tbody .who").all_inner_texts()]


@pytest.mark.parametrize("camera", ["orbit", "top"])
def test_drones_appear_in_their_colour_where_the_projection_puts_them(page, camera):
    view = {"camera": camera, "follow": 1, "trail": {"length": 0}}
    page.seek(10.0, **view)
    empty = page.shown()  # by then they have all moved on
    state = page.seek(4.0, **view)
    picture = page.shown()
    for index, circler in enumerate(FIELD):
        at = project(state["camera"], circler.position(4.0))
        np.testing.assert_allclose(state["drones"][index]["screen"], at, atol=0.5)
        before, after = (np.sum(likeness(shown, at, index) > 0.97) for shown in (empty, picture))
        assert before <= 2, f"there is something of drone {index + 1}'s colour at {at}"
        assert after >= 10, f"drone {index + 1} is not at {at}"


def likeness(picture, at, drone):
    """1 for pixels around a place that have the hue of a drone, less for others."""
    return hues(around(picture, at, reach=6)) @ hues(colour(drone_colour(drone)))


def test_a_trail_is_drawn_where_the_drone_has_flown_and_ends_at_the_drone(page):
    state = page.seek(8.0, camera="top", follow=1)
    picture = page.shown()
    ours = colour(drone_colour(1))
    behind = project(state["camera"], FIELD[1].position(np.array([7.5, 7.4, 7.3])))
    assert all(np.abs(around(picture, at, reach=1) - ours).max(axis=1).min() <= 3 for at in behind)
    ahead = project(state["camera"], FIELD[1].position(np.array([8.4, 8.6])))
    older = project(state["camera"], FIELD[1].position(4.5))
    for at in (*ahead, older):
        assert np.abs(around(picture, at, reach=1) - ours).max(axis=1).min() > 40


def test_trails_by_speed_have_the_colours_of_the_scale(page):
    state = page.seek(8.0, camera="top", follow=1, trail={"bySpeed": True})
    at = project(state["camera"], FIELD[1].position(7.5))
    # Drone 2 is the fastest of all, so its trail has the bright end of viridis.
    assert np.abs(around(page.shown(), at, reach=1) - colour("#fde725")).max(axis=1).min() <= 12
    assert page.text("#fastest") == f"{FIELD[1].rate * FIELD[1].radius:.1f} m/s"


def test_a_drone_that_crashed_is_grey_and_stays_where_it_was(page):
    flying, crashed = page.seek(5.9, follow=1), page.seek(9.0)
    np.testing.assert_allclose(crashed["drones"][2]["position"], FIELD[2].position(6.0), atol=2e-3)
    assert flying["standings"][2]["drone"] == 2
    at = project(crashed["camera"], FIELD[2].position(6.0))
    pixels = around(page.shown(), at, reach=4)
    colourful = np.ptp(pixels, axis=1) > 60
    assert not (colourful & (hues(pixels) @ hues(colour(drone_colour(2))) > 0.9)).any()
    assert np.ptp(pixels, axis=0).max() > 25  # but something is there


def test_the_next_gate_of_the_followed_drone_is_lit(page, race):
    state = page.seek(4.0, follow=1)
    next_gate = len(FIELD[1].crossings(4.0)) % GATES
    below = race.gate_position - [0, 0, 1.25 + 0.025]  # the middle of the strip under each opening
    picture = page.shown()
    distances = [np.abs(around(picture, at) - HIGHLIGHT).max(axis=1).min() for at in project(state["camera"], below)]
    assert np.argmin(distances) == next_gate
    assert distances[next_gate] <= 6
    assert sorted(distances)[1] > 60


def test_chase_and_first_person_look_at_and_from_the_drone(page):
    chase = page.seek(7.0, camera="chase", follow=3)
    place = FIELD[3].position(7.0)
    at = project(chase["camera"], place)
    assert abs(at[0] - chase["camera"]["width"] / 2) < 20
    assert abs(at[1] / chase["camera"]["height"] - 0.5) < 0.25
    assert np.linalg.norm(np.subtract(chase["camera"]["position"], place)) < 3
    ride = page.seek(7.0, camera="first-person")
    assert np.linalg.norm(np.subtract(ride["camera"]["position"], place)) < 0.15
    forward = rotate(ride["camera"]["quaternion"], [0.0, 0.0, -1.0])
    heading = FIELD[3].velocity(7.0) / np.linalg.norm(FIELD[3].velocity(7.0))
    assert forward @ heading > np.cos(np.radians(30))


@pytest.mark.parametrize("camera", ["chase", "first-person", "top"])
def test_a_picture_depends_on_time_and_camera_alone(page, camera):
    page.seek(3.0, camera=camera, follow=0)
    first = page.shown()
    page.seek(11.0)
    assert (page.shown() != first).any()
    page.seek(3.0)
    assert (page.shown() == first).all()


def test_it_plays_at_the_speed_asked_for_and_stops_at_the_end(page):
    page.run("() => { replay.seek(1, { speed: 4 }); replay.play() }")
    page.until("replay.state().time > 2")
    assert page.state()["playing"]
    page.until("replay.state().time === replay.duration && !replay.state().playing")
    assert page.text("#time") == "14.00"
    frames = page.run("replay.frames")
    page.page.wait_for_timeout(200)
    assert page.run("replay.frames") == frames  # nothing is drawn while nothing changes


def test_keys_do_what_the_help_says(page):
    press = page.page.keyboard.press
    page.seek(3.0)
    press("ArrowRight")
    assert page.state()["time"] == 4.0
    press("Shift+ArrowLeft")
    assert page.state()["time"] == pytest.approx(3.9)
    press("ArrowUp")
    assert page.state()["speed"] == 2
    for key, camera in zip("ctfo", ("chase", "top", "first-person", "orbit"), strict=True):
        press(key)
        assert page.state()["camera"]["mode"] == camera
    press("4")
    assert page.state()["followed"] == 3
    press("0")
    press("e")
    page.until("document.querySelector('#ticker').innerText.includes('overtakes')")
    press("s")
    assert page.state()["trail"]["bySpeed"]
    press("d")
    assert page.state()["theme"] == "light"
    press("h")
    assert "play or pause" in page.text("#help")
    press("Escape")
    page.until("!document.querySelector('#help').open")
    press("Space")
    page.until("replay.state().playing")
    press("Space")
    press("n")
    page.until("replay.state().race === 1")


def test_pointer_scrubs_follows_and_turns(page):
    box = page.page.locator("#drawing canvas").bounding_box()
    x = box["x"] + 36 + 0.5 * (box["width"] - 48)
    page.page.mouse.click(x, box["y"] + 20)
    assert page.state()["time"] == pytest.approx(7.0, abs=0.05)
    page.page.locator("#board tbody tr", has_text="rookie").click()
    assert page.state()["followed"] == 2
    before = page.state()["camera"]["position"]
    page.page.mouse.move(500, 300)
    page.page.mouse.down()
    page.page.mouse.move(640, 340)
    page.page.mouse.up()
    page.until(f"replay.state().camera.position[0] !== {before[0]}")
    page.page.get_by_role("button", name="chase").click()
    assert page.state()["camera"]["mode"] == "chase"
    page.page.select_option("#speed", "0.1")
    assert page.state()["speed"] == 0.1


def test_marks_say_what_happened(page):
    crash = page.run(
        """() => {
          const canvas = document.querySelector('#drawing canvas'), box = canvas.getBoundingClientRect();
          const lanes = 4 * 11, x = 36 + (6 / 14) * (box.width - 48);
          return [box.left + x, box.top + box.height - lanes + 2.5 * 11];
        }"""
    )
    page.page.mouse.move(*crash)
    assert page.text("#tip") == "6.00 s Drone 3 hits the ground"
    page.page.mouse.click(*crash)
    assert page.state()["time"] == 6.0
    page.until("document.querySelector('#ticker').innerText === 'Drone 3 hits the ground'")


def test_races_are_stepped_through(page):
    assert page.page.locator("#races option").all_inner_texts() == [
        "first: nobody finishes, 1 out",
        "second: nobody finishes",
        "third: drone 2 wins, 1 out",
    ]
    page.page.locator("#next-race").click()
    page.until("replay.state().race === 1")
    assert len(page.state()["drones"]) == 1
    page.page.select_option("#races", "2")
    page.until("replay.state().race === 2")
    last = page.seek(12.0)["standings"][0]
    assert (last["drone"], last["status"]) == (1, "finished")
    assert f"{FIELD[1].crossings(12.0)[GATES]:.2f}" in page.text("#board")


def test_pilots_names_are_text(page):
    assert "<b>&amp;" in page.text("#board")


@pytest.mark.parametrize("scheme", ["dark", "light"])
@pytest.mark.parametrize("size", [(390, 844), (844, 390), (1280, 720)])
def test_everything_is_in_view_and_readable(open_page, race_file, size, scheme):
    page = open_page(f"{race_file.as_uri()}#t=4", size=size, scheme=scheme)
    assert page.state()["theme"] == scheme
    assert page.run("[document.documentElement.scrollWidth, document.body.scrollHeight]") <= list(size)
    boxes = page.run(
        """() => Object.fromEntries(
          ['header', '#panel', '#tools', '#timeline', '#transport', '#cameras', '#follow', '#clock'].map((name) => {
            const box = document.querySelector(name).getBoundingClientRect();
            return [name, [box.left, box.top, box.right, box.bottom]];
          }))"""
    )
    for name, (left, top, right, bottom) in boxes.items():
        assert 0 <= left < right <= size[0], name
        assert 0 <= top < bottom <= size[1], name
    camera = page.state()["camera"]
    left, top, right, bottom = boxes["#panel"]
    for column, row in project(camera, [circler.position(4.0) for circler in FIELD]):
        assert 0 < column < size[0]
        assert 0 < row < camera["height"]
        assert not (left < column < right and top < row < bottom)
    picture = page.shown()
    ground = np.median(picture[: camera["height"]], axis=(0, 1)).mean()
    assert ground < 60 if scheme == "dark" else ground > 200
    for selector in ("#title", "#subtitle", "#board td.lap", "#time", "#duration"):
        assert contrast(page, selector) >= 4.5, selector


@pytest.mark.parametrize("size", [(390, 844), (844, 390), (1280, 720)])
def test_no_column_of_the_board_is_cut_off(open_page, tmp_path, size):
    """With names as long as pilots have: in flight, after a crash, when time is up."""
    path = tmp_path / "race.html"
    write_replay(path, [circle_race(pilots=np.array(["racer-figure-eight-field"] * 4))], ["it"])
    page = open_page(path.as_uri(), size=size)
    for t in (3.0, 7.0, 14.0):
        page.seek(t)
        assert page.run("(board => board.scrollWidth <= board.clientWidth)(document.querySelector('#board'))"), t


def contrast(page, selector):
    """WCAG contrast of a text with what lies behind it, panels taken as opaque."""
    ink, paper = page.run(
        """selector => {
          const element = document.querySelector(selector);
          let behind = element;
          const colour = (e) => getComputedStyle(e).backgroundColor;
          while (behind.parentElement && /, 0(\\.\\d+)?\\)$/.test(colour(behind))) behind = behind.parentElement;
          return [getComputedStyle(element).color, colour(behind)];
        }""",
        selector,
    )
    lights = sorted(luminance(text) for text in (ink, paper))
    return (lights[1] + 0.05) / (lights[0] + 0.05)


def luminance(text):
    numbers = text[text.index("(") + 1 : -1].replace(",", " ").split()[:3]
    parts = np.array([float(number) for number in numbers]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def test_it_follows_the_window(open_page, race_file):
    page = open_page(f"{race_file.as_uri()}#t=4&camera=top")
    page.page.set_viewport_size({"width": 500, "height": 800})
    page.until("replay.state().camera.width === 500")
    state = page.seek(4.0)
    at = project(state["camera"], [circler.position(4.0) for circler in FIELD])
    assert ((at > 0) & (at < [500, state["camera"]["height"]])).all()


def test_an_address_names_a_moment(open_page, race_file):
    page = open_page(f"{race_file.as_uri()}#t=2.5&camera=chase&drone=3&race=3&theme=light")
    state = page.state()
    assert (state["time"], state["camera"]["mode"], state["followed"]) == (2.5, "chase", 2)
    assert (state["race"], state["theme"], state["playing"]) == (2, "light", False)


def test_damaged_data_is_said_to_be_damaged(browser, race_file, tmp_path):
    from tests.viewer.browser import Page

    damaged = tmp_path / "damaged.html"
    damaged.write_bytes(race_file.read_bytes().replace(b'"format":1', b'"format":9', 1))
    page = Page(browser, damaged.as_uri())
    assert "this page reads format 1, the data has 9" in page.text("#empty")
    page.close()


def test_a_ghost_is_shown_out_of_competition(open_page, tmp_path):
    from cruise.viewer.page import replay_page

    path = tmp_path / "ghost.html"
    path.write_bytes(replay_page([circle_race()], ["now"], circle_race((FIELD[1],), seconds=9.0)))
    page = open_page(path.as_uri())
    state = page.seek(4.0)
    assert [drone["ghost"] for drone in state["drones"]] == [False] * 4 + [True]
    assert len(state["standings"]) == 4
    np.testing.assert_allclose(state["drones"][4]["position"], FIELD[1].position(4.0), atol=2e-3)
