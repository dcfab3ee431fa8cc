"""Films show drones in their colours where a camera sees them, and are files that others can play."""

import io
import sys

import numpy as np
import pytest
from PIL import Image, ImageColor

from cruise.cli.main import main
from cruise.errors import CruiseError
from cruise.extras import how_to_install
from cruise.palette import drone_colour
from cruise.viewer.film import files
from cruise.viewer.film.film import frame_times, frames, margins_of
from cruise.viewer.film.flights import make_flight
from cruise.viewer.painting import scenery
from cruise.viewer.painting.camera import fit_camera
from cruise.viewer.standings import commentary, make_course, standings
from tests.storage.logs import small_log
from tests.viewer.browser import around, hues
from tests.viewer.races import FIELD, circle_race

SIZE, MARGINS = (480, 270), (90.0, 10.0, 10.0, 20.0)


@pytest.fixture(scope="module")
def race():
    return circle_race()


@pytest.fixture
def small_films(monkeypatch):
    """Films of few pixels."""
    monkeypatch.setattr(files, "GIF_SIZE", (160, 90))
    monkeypatch.setattr(files, "MP4_SIZE", (160, 96))
    monkeypatch.setattr(files, "MP4_RATE", 10.0)


def camera_of(log, size, margins):
    return fit_camera(scenery.must_be_seen(scenery.log_scenery(log)), size, margins)


def test_every_gate_is_seen_between_the_margins(race):
    camera = camera_of(race, SIZE, MARGINS)
    height = race.gate_size[:, 1:] / 2 * [[0.0, 0.0, 1.0]]
    for places in (race.gate_position + height, race.gate_position - height, race.gate_position * [1, 1, 0]):
        pixels, depth = camera.project(places)
        assert (depth > 0).all()
        assert (pixels >= [90, 10]).all()
        assert (pixels <= [SIZE[0] - 10, SIZE[1] - 20]).all()


def test_projection_is_that_of_a_pinhole(race):
    """Against similar triangles along each axis, for a point whose parts along the camera's axes are chosen."""
    camera = camera_of(race, SIZE, MARGINS)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(camera.axes[0], camera.axes[1]), camera.axes[2], atol=1e-12)
    right, up, ahead = 1.5, 0.5, 20.0
    point = camera.position_w + right * camera.axes[0] + up * camera.axes[1] - ahead * camera.axes[2]
    pixel, depth = camera.project(point)
    expected = camera.middle + camera.focal * np.array([right / ahead, -up / ahead])
    np.testing.assert_allclose(pixel, expected)
    assert depth == pytest.approx(ahead)


@pytest.mark.parametrize("drone", range(4))
def test_between_samples_drones_are_on_their_circles(race, drone):
    flight = make_flight(race, drone)
    times = np.linspace(0.0, 14.0, 57)
    np.testing.assert_allclose(flight.position_at(times), FIELD[drone].position(times), atol=1e-3)
    heading = FIELD[drone].velocity(3.33) / np.linalg.norm(FIELD[drone].velocity(3.33))
    np.testing.assert_allclose(flight.axes_at(3.33)[:, 0], heading, atol=1e-3)


def test_drones_have_their_colours_in_the_picture(race):
    (picture,) = frames(race, (960, 540), 10.0, (4.0, 4.1))
    (empty,) = frames(race, (960, 540), 10.0, (10.0, 10.1))
    camera = camera_of(race, (960, 540), margins_of(960))
    for drone, circler in enumerate(FIELD):
        at = camera.project(circler.position(4.0))[0]
        likeness = [
            hues(around(np.asarray(shown), at, reach=7)) @ hues(np.array(ImageColor.getrgb(drone_colour(drone)), float))
            for shown in (picture, empty)
        ]
        assert np.sum(likeness[0] > 0.97) >= 15
        assert np.sum(likeness[1] > 0.97) <= 3


def test_a_picture_depends_on_time_alone(race):
    first, second = (np.asarray(next(frames(race, SIZE, 10.0, (3.0, 3.1)))) for _ in range(2))
    assert (first == second).all()
    assert (first != np.asarray(next(frames(race, SIZE, 10.0, (3.1, 3.2))))).any()


def test_order_and_words(race):
    course = make_course(race)
    assert [row.drone for row in standings(course, 14.0)] == list(course.result.ranking)
    assert [row.drone for row in standings(course, 0.0)] == [0, 2, 1, 3]
    early = standings(course, 1.0)
    assert [(row.drone, row.passed, row.lap) for row in early[:2]] == [(0, 1, 1), (2, 1, 1)]
    assert early[1].gap == pytest.approx(FIELD[2].crossings(9.0)[0] - FIELD[0].crossings(9.0)[0])
    assert {row.drone: row.status for row in standings(course, 6.0)}[2] == "hit the ground"
    said = commentary(course)
    assert (6.0, "Drone 3 hits the ground") in said
    assert [text for _, text in commentary(make_course(circle_race(seconds=12.0, laps=1)))][-1] == "Drone 2 wins"


def test_pictures_are_taken_at_the_rate(race):
    whole = frame_times(race, 10.0, None)
    assert whole[:3] == [0.0, 0.1, 0.2]
    assert whole.count(14.0) == 16  # the end is held
    assert frame_times(race, 10.0, (13.8, 99.0)) == pytest.approx([13.8, 13.9])
    with pytest.raises(CruiseError, match=r"a clip from 15 to 16 s does not lie within the race, which lasts 14.00 s"):
        frame_times(race, 10.0, (15.0, 16.0))


def test_gif_repeats_and_shows_what_was_painted(race, small_films):
    painted = list(frames(race, files.GIF_SIZE, files.GIF_RATE, (4.0, 4.8)))
    with Image.open(io.BytesIO(files.draw_gif(race, (4.0, 4.8)))) as film:
        assert (film.format, film.size, film.n_frames, film.info["loop"]) == ("GIF", (160, 90), len(painted), 0)
        assert film.info["duration"] == 60
        for number, picture in enumerate(painted):
            film.seek(number)
            shown = np.asarray(film.convert("RGB")).astype(float)
            assert np.abs(shown - np.asarray(picture)).mean() < 3.0
            assert np.quantile(np.abs(shown - np.asarray(picture)), 0.99) < 30
        colours = {tuple(colour) for colour in shown.astype(int).reshape(-1, 3).tolist()}
    assert ImageColor.getrgb(drone_colour(0)) in colours


def test_mp4_can_be_played(race, small_films, tmp_path):
    import imageio_ffmpeg

    content = files.draw_mp4(race, (4.0, 5.0))
    (tmp_path / "race.mp4").write_bytes(content)
    assert content[4:8] == b"ftyp"
    assert content.index(b"moov") < content.index(b"mdat")  # a browser can begin before it has all
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "race.mp4"))
    about = next(reader)
    pictures = [np.frombuffer(frame, np.uint8) for frame in reader]
    assert (about["codec"], about["size"], about["fps"], len(pictures)) == ("h264", (160, 96), 10.0, 10)
    assert np.abs(pictures[0].astype(float) - pictures[-1]).max() > 60


def test_strange_races_give_films(small_films):
    for log in (small_log(samples=1), small_log(drones=16), circle_race((FIELD[0],))):
        assert files.draw_gif(log, None if log.time[-1] < 1 else (0.0, 0.2)).startswith(b"GIF89a")


@pytest.fixture
def log_file(tmp_path, monkeypatch, race):
    monkeypatch.chdir(tmp_path)
    race.save("race.npz")


@pytest.mark.usefixtures("log_file", "small_films")
def test_films_from_the_command_line(tmp_path, capsys):
    assert main(["replay", "race.npz", "--gif", "a.gif", "--mp4", "a.mp4", "--clip", "4", "4.3"]) == 0
    assert capsys.readouterr().out == "replay   race.html\nfilm     a.gif\nfilm     a.mp4\n"
    assert {path.name for path in tmp_path.iterdir()} == {"race.npz", "race.html", "a.gif", "a.mp4"}


BAD = {
    "picture of another kind": ("--gif a.webp", "--gif must name a .gif file"),
    "film of another kind": ("--mp4 a.avi", "--mp4 must name a .mp4 file"),
    "backwards": ("--gif a.gif --clip 5 4", "--clip takes two times in seconds, the earlier first, got 5.0 4.0"),
    "outside": ("--gif a.gif --clip 20 30", "a clip from 20 to 30 s does not lie within the race"),
}


@pytest.mark.parametrize("case", BAD)
@pytest.mark.usefixtures("log_file")
def test_bad_flags_give_one_line_and_no_files(case, tmp_path, capsys):
    flags, message = BAD[case]
    assert main(["replay", "race.npz", *flags.split()]) == 2
    output = capsys.readouterr()
    assert message in output.err
    assert output.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["race.npz"]


@pytest.mark.usefixtures("log_file")
def test_without_the_extra_one_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert main(["replay", "race.npz", "--mp4", "a.mp4"]) == 2
    assert capsys.readouterr().err == f"error: --mp4 needs imageio-ffmpeg: {how_to_install('video')}\n"
