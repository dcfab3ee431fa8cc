"""The two settings: the paper's caps, and what the vehicle can do."""

import dataclasses
import json

import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.pilots.named import NAMED
from cruise.pilots.se_ibr.settings import (
    HORIZONTAL_CAP,
    PAPER_SPEEDS,
    STYLE_KEYS,
    TUNED,
    VERTICAL_CAP,
    paper_style,
    read_tuned,
    style_of,
    turning_speed,
)
from cruise.presets import PAPER_TRACKS, VEHICLES
from cruise.racing.track_file import load_track
from tests.helpers import random_track

PAPER = VEHICLES["paper"]
OVAL = load_track("examples/tracks/oval.toml")


@pytest.mark.parametrize("track", PAPER_TRACKS)
def test_the_papers_speeds(track):
    """The rule for other tracks comes within 4 % of what was measured on the paper's."""
    assert paper_style(PAPER_TRACKS[track]).speed == PAPER_SPEEDS[track]
    assert turning_speed(PAPER_TRACKS[track]) == pytest.approx(PAPER_SPEEDS[track], rel=0.04)


@pytest.mark.parametrize("track", [OVAL, random_track(0), random_track(3)])
def test_the_caps_hold_elsewhere(track):
    speed = style_of("paper", track, PAPER).speed
    assert 1.0 < speed <= HORIZONTAL_CAP


def test_a_steep_track_is_flown_slower():
    """Gates at 2 m and 10 m in turn, 10 m apart: the vertical cap decides."""
    gates = tuple(
        dataclasses.replace(gate, position_w=(*gate.position_w[:2], 2.0 if k % 2 else 10.0))
        for k, gate in enumerate(PAPER_TRACKS["ring"].gates[:4])
    )
    steep = dataclasses.replace(PAPER_TRACKS["ring"], gates=gates)
    assert turning_speed(steep) < turning_speed(PAPER_TRACKS["ring"])
    assert turning_speed(steep) * 0.6 < VERTICAL_CAP


def test_tuned_is_read_from_the_file_of_the_command():
    tracks = json.loads(TUNED.read_text())["tracks"]
    assert tracks.keys() == PAPER_TRACKS.keys()
    for name, track in PAPER_TRACKS.items():
        style = style_of("tuned", track, PAPER)
        assert style._asdict() == tracks[name]["style"]
        assert style.speed > 1.5 * PAPER_SPEEDS[name]


def test_a_track_is_known_by_its_gates():
    renamed = dataclasses.replace(PAPER_TRACKS["ring"], name="mine", laps=7)
    assert style_of("tuned", renamed, PAPER) == style_of("tuned", PAPER_TRACKS["ring"], PAPER)


def test_elsewhere_the_most_careful_of_what_was_found():
    known = [style_of("tuned", track, PAPER) for track in PAPER_TRACKS.values()]
    here = style_of("tuned", OVAL, PAPER)
    assert here.speed == min(style.speed for style in known)
    assert here.acceleration == min(style.acceleration for style in known)
    assert here.margin == max(style.margin for style in known)


def test_other_vehicles_fly_at_a_share_of_what_they_can():
    racer = VEHICLES["racer"]
    style = style_of("tuned", OVAL, racer)
    assert PAPER.tracking.speed < style.speed <= racer.tracking.speed
    assert style.acceleration < np.sqrt(racer.agility**2 - racer.gravity**2)
    assert style_of("paper", OVAL, racer) == style_of("paper", OVAL, PAPER)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"tracks": {"ring": {}}}', '{"tracks": {"ring": {"style": {"speed": "x"}}}}']
)
def test_a_file_of_something_else_is_refused(tmp_path, text):
    path = tmp_path / "tuned.json"
    path.write_text(text)
    with pytest.raises(CruiseError, match="is no file of `cruise tune-planner`"):
        read_tuned(path)
    with pytest.raises(CruiseError, match="is no file of `cruise tune-planner`"):
        read_tuned(tmp_path / "missing.json")


def test_names():
    assert {"chaser", "hover", "se-ibr", "se-ibr-tuned"} <= NAMED.keys()
    assert all(name == pilot.name for name, pilot in NAMED.items())
    assert set(STYLE_KEYS) == set(type(paper_style(OVAL))._fields)
