"""Poles, walls and gates of every kind are seen where they stand, in films and on the page, wherever the track is."""

import math

import numpy as np
import pytest

from cruise import geometry
from cruise.palette import COLOURS, drone_colour
from cruise.racing.shapes import footprint, opening
from cruise.racing.solids import outlines
from cruise.storage.log_track import gates_of, solids_of
from cruise.storage.race_log import EVENT_KINDS, EventKind
from cruise.viewer.film.film import frames, margins_of
from cruise.viewer.packing import pack_race
from cruise.viewer.page import write_replay
from cruise.viewer.painting import scenery
from cruise.viewer.painting.camera import fit_camera
from tests.racing.obstacles import distance
from tests.viewer.browser import around, colour, hues, project
from tests.viewer.races import FIELD, LEANING, SOLIDS, solid_race

WOOD = {scheme: hues(colour(COLOURS[scheme]["scene"]["solid"])) for scheme in ("dark", "light")}
SIZE = (960, 540)
PLACES = {"pole": (3.0, 3.0, 4.0), "thick pole": (-4.0, 2.0, 2.0), "wall": (0.0, 0.0, 2.0)}  # within solids


@pytest.fixture(scope="module")
def race():
    return solid_race()


def test_a_log_gives_back_the_gates_and_solids_of_its_track(race):
    assert gates_of(race) == LEANING
    assert solids_of(race) == tuple(outlines(SOLIDS))


@pytest.mark.parametrize("gate", LEANING)
def test_the_rim_of_an_opening_lies_in_its_plane_on_its_edge(gate):
    for beyond in (0.0, 0.3):
        offset = tuple((opening(gate, beyond) - gate.position_w).T)
        forward, left, up = geometry.to_gate(
            geometry.heading_of(gate.yaw), offset, geometry.tilt_of(gate.roll, gate.pitch)
        )
        np.testing.assert_allclose(forward, 0, atol=1e-12)
        is_round = True if gate.shape == "round" else None
        edge = geometry.beyond_opening(left, up, gate.width / 2, gate.height / 2, is_round)
        np.testing.assert_allclose(edge, beyond, atol=1e-12)
        turns = left * np.roll(up, -1) - up * np.roll(left, -1)
        assert (turns < 0).all() or (turns > 0).all()


@pytest.mark.parametrize("solid", SOLIDS)
def test_patches_lie_on_the_faces_of_a_solid_and_face_out(solid):
    (outline,) = outlines((solid,))
    for patch in scenery.patches(outline):
        middle = patch.corners_w.mean(axis=0)
        flat = (patch.corners_w - middle) @ patch.normal_w
        np.testing.assert_allclose(flat, 0, atol=1e-9)
        shrunk = middle + 0.98 * (patch.corners_w - middle)
        assert distance(solid, shrunk + 0.1 * patch.normal_w).min() > 0.05
        assert distance(solid, shrunk - 0.05 * patch.normal_w).max() == 0
    corners = np.column_stack([footprint(outline), np.full(len(footprint(outline)), 1.0)])
    assert distance(solid, corners).max() < 1e-9


def test_the_film_shows_solids_where_they_stand(race):
    (picture,) = frames(race, SIZE, 10.0, (0.0, 0.1))
    camera = fit_camera(scenery.must_be_seen(scenery.log_scenery(race)), SIZE, margins_of(SIZE[0]))
    for place in PLACES.values():
        at = camera.project(np.array(place))[0]
        assert np.mean(hues(around(np.asarray(picture), at, reach=2)) @ WOOD["dark"] > 0.97) > 0.5


@pytest.fixture(scope="module")
def address(tmp_path_factory, race):
    path = tmp_path_factory.mktemp("solids") / "race.html"
    write_replay(path, [race], ["solid"])
    return path.as_uri()


@pytest.mark.parametrize("scheme", ["dark", "light"])
@pytest.mark.parametrize("size", [(1000, 640), (390, 740)])
def test_the_page_shows_solids_where_they_stand(open_page, address, scheme, size):
    page = open_page(address, size=size, scheme=scheme)
    for camera in ("orbit", "top"):
        state = page.seek(0.0, camera=camera)
        picture = page.shown()
        for place in PLACES.values():
            at = project(state["camera"], place)
            assert np.mean(hues(around(picture, at, reach=2)) @ WOOD[scheme] > 0.95) > 0.5, (camera, place)


def test_the_page_has_the_lights_of_tilted_and_round_gates_round_their_openings(open_page, address):
    page = open_page(address, size=(1000, 640))
    state = page.seek(0.0, camera="orbit")
    picture, light = page.shown(), colour(COLOURS["dark"]["scene"]["gateStrip"])
    for gate in LEANING[1:]:  # the first is lit as the next
        seen = [around(picture, at, reach=1) for at in project(state["camera"], opening(gate, 0.025)[::2])]
        assert np.mean([np.abs(pixels - light).max(axis=1).min() < 40 for pixels in seen]) > 0.8


@pytest.mark.parametrize("away", [(500.0, 0.0, 0.0), (-2000.0, 3000.0, 0.0)])
def test_a_track_far_from_the_origin_is_seen_as_one_at_the_origin(open_page, address, tmp_path, away):
    path = tmp_path / "far.html"
    write_replay(path, [solid_race(away)], ["far"])
    near, far = open_page(address), open_page(path.as_uri())
    for camera in ("orbit", "chase", "top"):
        here, there = near.seek(4.0, camera=camera), far.seek(4.0, camera=camera)
        shift = np.subtract(there["camera"]["position"], here["camera"]["position"])
        np.testing.assert_allclose(shift, away, atol=0.02)
        for one, other in zip(here["drones"], there["drones"], strict=True):
            if one["screen"] is not None:
                np.testing.assert_allclose(one["screen"], other["screen"], atol=1.5)
    at = far.seek(4.0, camera="orbit")["drones"][1]["screen"]
    assert np.sum(hues(around(far.shown(), np.array(at), reach=6)) @ hues(colour(drone_colour(1))) > 0.97) >= 10


def test_a_large_track_is_seen_whole(open_page, tmp_path):
    """Two kilometres across: farther than the camera once could see."""
    race = solid_race()
    large = solid_race(gate_position=race.gate_position * 120)
    path = tmp_path / "large.html"
    write_replay(path, [large], ["large"])
    page = open_page(path.as_uri())
    for camera in ("orbit", "top"):
        state = page.seek(0.0, camera=camera)["camera"]
        pixels = project(state, large.gate_position)
        assert (pixels > 0).all()
        assert (pixels < [state["width"], state["height"]]).all()
        assert page.run("[...document.querySelectorAll('.gate-label')].filter((label) => !label.hidden).length") == 4


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_a_chosen_button_can_be_read_under_the_pointer(open_page, address, scheme):
    page = open_page(address, scheme=scheme)
    page.page.hover("#cameras [aria-pressed=true]")
    found = page.run(
        "(() => { const style = getComputedStyle(document.querySelector('#cameras [aria-pressed=true]'));"
        " return [style.color, style.backgroundColor]; })()"
    )
    ink, ground = (luminance([float(part) for part in text.strip("rgb()").split(",")[:3]]) for text in found)
    assert (max(ink, ground) + 0.05) / (min(ink, ground) + 0.05) > 4.5  # WCAG 2.2, AA


def luminance(rgb):
    parts = [value / 255 for value in rgb]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return math.fsum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def test_events_are_named_on_the_page(open_page, tmp_path):
    """A drone that hits a pole: in the data by its name, on the page in words."""
    race = solid_race()
    kinds = np.where(race.event_kind == EventKind.COLLISION_GROUND, EventKind.COLLISION_POLE, race.event_kind)
    race = solid_race(event_kind=kinds.astype(np.int32), event_kind_names=np.array(EVENT_KINDS))
    assert "collision_pole" in [event["kind"] for event in pack_race(race, "x")["events"]]
    path = tmp_path / "pole.html"
    write_replay(path, [race], ["pole"])
    page = open_page(path.as_uri())
    page.seek(FIELD[2].crash + 0.1)
    assert "Drone 3 hits a pole" in page.text("#ticker")
    assert "hit a pole" in page.text("#board")
